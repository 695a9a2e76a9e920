// What the service says about itself: its health, its contract, its pages.
#pragma once

#include "server/call.h"

namespace kdray::server {

api::Outcome<HttpResponse> GetViewerFile(const Services& services, Call& call);
api::Outcome<HttpResponse> GetHealth(const Services& services, Call& call);
api::Outcome<HttpResponse> GetReadiness(const Services& services, Call& call);
api::Outcome<HttpResponse> GetCapabilities(const Services& services, Call& call);
api::Outcome<HttpResponse> GetOpenApi(const Services& services, Call& call);
api::Outcome<HttpResponse> GetDocs(const Services& services, Call& call);
api::Outcome<HttpResponse> GetProblemPage(const Services& services, Call& call);

}  // namespace kdray::server
