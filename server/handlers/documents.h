// SPDX-License-Identifier: Apache-2.0
// The service's health, contract and pages.
#pragma once

#include "server/handler.h"

namespace kdray::server {

api::Outcome<HttpResponse> GetViewerFile(const HandlerContext& context, RoutedRequest& routed);
api::Outcome<HttpResponse> GetHealth(const HandlerContext& context, RoutedRequest& routed);
api::Outcome<HttpResponse> GetReadiness(const HandlerContext& context, RoutedRequest& routed);
api::Outcome<HttpResponse> GetMetrics(const HandlerContext& context, RoutedRequest& routed);
api::Outcome<HttpResponse> GetCapabilities(const HandlerContext& context, RoutedRequest& routed);
api::Outcome<HttpResponse> GetOpenApi(const HandlerContext& context, RoutedRequest& routed);
api::Outcome<HttpResponse> GetDocs(const HandlerContext& context, RoutedRequest& routed);
api::Outcome<HttpResponse> GetProblemPage(const HandlerContext& context, RoutedRequest& routed);

}  // namespace kdray::server
