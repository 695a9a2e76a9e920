// SPDX-License-Identifier: Apache-2.0
// Images: /v1/trees/{id}/render.png and render.npy, the fields as parameters (GET) or as JSON
// (POST).
#pragma once

#include "server/handler.h"

namespace kdray::server {

api::Outcome<HttpResponse> GetRenderPng(const HandlerContext& context, RoutedRequest& routed);
api::Outcome<HttpResponse> PostRenderPng(const HandlerContext& context, RoutedRequest& routed);
api::Outcome<HttpResponse> GetRenderNpy(const HandlerContext& context, RoutedRequest& routed);
api::Outcome<HttpResponse> PostRenderNpy(const HandlerContext& context, RoutedRequest& routed);

}  // namespace kdray::server
