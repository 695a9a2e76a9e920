// SPDX-License-Identifier: Apache-2.0
// Uploads and trees: /v1/trees and below.
#pragma once

#include "server/handler.h"

namespace kdray::server {

api::Outcome<HttpResponse> PostTree(const HandlerContext& context, RoutedRequest& routed);
api::Outcome<HttpResponse> ListTrees(const HandlerContext& context, RoutedRequest& routed);
api::Outcome<HttpResponse> GetTree(const HandlerContext& context, RoutedRequest& routed);
api::Outcome<HttpResponse> DeleteTree(const HandlerContext& context, RoutedRequest& routed);
api::Outcome<HttpResponse> GetMesh(const HandlerContext& context, RoutedRequest& routed);

}  // namespace kdray::server
