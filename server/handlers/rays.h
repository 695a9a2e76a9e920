// Batches of ray queries: /v1/trees/{id}/rays/….
#pragma once

#include "server/call.h"

namespace kdray::server {

api::Outcome<HttpResponse> PostRaysClosest(const Services& services, Call& call);
api::Outcome<HttpResponse> PostRaysAny(const Services& services, Call& call);

}  // namespace kdray::server
