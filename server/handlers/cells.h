// The boxes of a tree: /v1/trees/{id}/cells.
#pragma once

#include "server/call.h"

namespace kdray::server {

api::Outcome<HttpResponse> GetCells(const Services& services, Call& call);

}  // namespace kdray::server
