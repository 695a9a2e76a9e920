// SPDX-License-Identifier: Apache-2.0
// The boxes of a tree: /v1/trees/{id}/cells.
#pragma once

#include "server/handler.h"

namespace kdray::server {

api::Outcome<HttpResponse> GetCells(const HandlerContext& context, RoutedRequest& routed);

}  // namespace kdray::server
