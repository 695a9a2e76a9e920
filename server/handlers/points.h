// SPDX-License-Identifier: Apache-2.0
// POST /v1/trees/{id}/points/…
#pragma once

#include "server/handler.h"

namespace kdray::server {

api::Outcome<HttpResponse> PostPointsClosest(const HandlerContext& context, RoutedRequest& routed);
api::Outcome<HttpResponse> PostPointsSignedDistance(const HandlerContext& context,
                                                    RoutedRequest& routed);
api::Outcome<HttpResponse> PostPointsInside(const HandlerContext& context, RoutedRequest& routed);

}  // namespace kdray::server
