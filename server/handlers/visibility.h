// SPDX-License-Identifier: Apache-2.0
// POST /v1/trees/{id}/visibility
#pragma once

#include "server/handler.h"

namespace kdray::server {

api::Outcome<HttpResponse> PostVisibility(const HandlerContext& context, RoutedRequest& routed);

}  // namespace kdray::server
