// Speed against accuracy on one mesh, measured: /v1/trees/{id}/tradeoff.
#pragma once

#include "server/call.h"

namespace kdray::server {

api::Outcome<HttpResponse> PostTradeoff(const Services& services, Call& call);
api::Outcome<HttpResponse> GetTradeoff(const Services& services, Call& call);
api::Outcome<HttpResponse> DeleteTradeoff(const Services& services, Call& call);

}  // namespace kdray::server
