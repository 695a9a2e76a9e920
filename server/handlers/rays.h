// Batches of ray queries: /v1/trees/{id}/rays/….
#pragma once

#include "server/handler.h"

namespace kdray::server {

api::Outcome<HttpResponse> PostRaysClosest(const HandlerContext& context, RoutedRequest& routed);
api::Outcome<HttpResponse> PostRaysAny(const HandlerContext& context, RoutedRequest& routed);

}  // namespace kdray::server
