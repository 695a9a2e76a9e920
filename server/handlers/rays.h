// SPDX-License-Identifier: Apache-2.0
// The handlers of ray queries: a batch of rays in, an answer per row out.
#pragma once

#include "server/handler.h"

namespace kdray::server {

api::Outcome<HttpResponse> PostRaysClosest(const HandlerContext& context, RoutedRequest& routed);
api::Outcome<HttpResponse> PostRaysAny(const HandlerContext& context, RoutedRequest& routed);
api::Outcome<HttpResponse> PostRaysCount(const HandlerContext& context, RoutedRequest& routed);
api::Outcome<HttpResponse> PostRaysAll(const HandlerContext& context, RoutedRequest& routed);

}  // namespace kdray::server
