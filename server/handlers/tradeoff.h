// SPDX-License-Identifier: Apache-2.0
// Speed against accuracy on one mesh, measured: /v1/trees/{id}/tradeoff.
#pragma once

#include "server/handler.h"

namespace kdray::server {

api::Outcome<HttpResponse> PostTradeoff(const HandlerContext& context, RoutedRequest& routed);
api::Outcome<HttpResponse> GetTradeoff(const HandlerContext& context, RoutedRequest& routed);
api::Outcome<HttpResponse> DeleteTradeoff(const HandlerContext& context, RoutedRequest& routed);

}  // namespace kdray::server
