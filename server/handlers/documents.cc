// SPDX-License-Identifier: Apache-2.0
#include "server/handlers/documents.h"

#include <optional>
#include <string>
#include <utility>

#include "api/answer_codec.h"
#include "api/errors.h"
#include "api/openapi_document.h"
#include "api/request_codec.h"
#include "server/handlers/answers.h"
#include "server/pages/contract_page.h"
#include "server/pages/html.h"
#include "server/pages/viewer_files.h"
#include "server/process_values.h"

namespace kdray::server {
namespace {

using api::ErrorCode;
using api::Problem;

/// For our pages with text and style only.
constexpr std::string_view kTextPagePolicy =
    "default-src 'none'; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'";

HttpResponse HtmlAnswer(const HandlerContext& context, HttpBody body, std::string_view policy) {
  HttpResponse response;
  response.body = std::move(body);
  response.headers.Add("Content-Type", "text/html; charset=utf-8");
  response.headers.Add("Content-Security-Policy", policy);
  response.headers.Add("Referrer-Policy", "no-referrer");
  SetCaching(response, context, Caching::kRevalidate);
  return response;
}

}  // namespace

api::Outcome<HttpResponse> GetViewerFile(const HandlerContext& context, RoutedRequest& routed) {
  // Parameters are for the page's scripts; the answer does not depend on them.
  for (const ViewerFile& file : ViewerFiles()) {
    if (file.path != routed.http.path) continue;
    if (ClientHas(routed.http, file.etag)) {
      return NotModified(context, file.etag, Caching::kRevalidate);
    }
    HttpResponse response = HtmlAnswer(context, HttpBody::Static(file.bytes), kViewerPolicy);
    response.headers.Set("Content-Type", file.content_type);
    response.headers.Add("ETag", file.etag);
    return response;
  }
  return Problem{.code = ErrorCode::kNotFound, .detail = "the viewer has no such file"};
}

api::Outcome<HttpResponse> GetHealth(const HandlerContext& context, RoutedRequest& routed) {
  if (auto problem = api::CheckNoParameters(routed.http.query_string)) return *std::move(problem);
  HttpResponse response = JsonAnswer(200, R"({"status":"ok"})");
  SetCaching(response, context, Caching::kNever);
  return response;
}

api::Outcome<HttpResponse> GetReadiness(const HandlerContext& context, RoutedRequest& routed) {
  if (auto problem = api::CheckNoParameters(routed.http.query_string)) return *std::move(problem);
  if (context.draining) {
    return Problem{.code = ErrorCode::kDraining, .detail = "this server is shutting down"};
  }
  HttpResponse response = JsonAnswer(200, R"({"status":"ready"})");
  SetCaching(response, context, Caching::kNever);
  return response;
}

api::Outcome<HttpResponse> GetMetrics(const HandlerContext& context, RoutedRequest& routed) {
  if (auto problem = api::CheckNoParameters(routed.http.query_string)) return *std::move(problem);
  HttpResponse response;
  response.body = context.metrics.Text({.backend = context.backend.counters(),
                                        .running = context.admission.running(),
                                        .queued = context.admission.queued(),
                                        .request_memory_bytes = context.memory.used(),
                                        .memory_limit_bytes = context.memory_limit_bytes,
                                        .dropped_log_lines = context.log.dropped(),
                                        .process = ReadProcessValues()});
  response.headers.Add("Content-Type", Metrics::kContentType);
  SetCaching(response, context, Caching::kNever);
  return response;
}

api::Outcome<HttpResponse> GetCapabilities(const HandlerContext& context, RoutedRequest& routed) {
  if (auto problem = api::CheckNoParameters(routed.http.query_string)) return *std::move(problem);
  HttpResponse response = JsonAnswer(200, api::EncodeCapabilities(KDRAY_VERSION, context.limits));
  SetCaching(response, context, Caching::kRevalidate);
  return response;
}

api::Outcome<HttpResponse> GetOpenApi(const HandlerContext& context, RoutedRequest& routed) {
  if (auto problem = api::CheckNoParameters(routed.http.query_string)) return *std::move(problem);
  HttpResponse response;
  response.body = HttpBody::Static(api::OpenApiJson());
  response.headers.Add("Content-Type", "application/json");
  SetCaching(response, context, Caching::kRevalidate);
  return response;
}

api::Outcome<HttpResponse> GetDocs(const HandlerContext& context, RoutedRequest& routed) {
  if (auto problem = api::CheckNoParameters(routed.http.query_string)) return *std::move(problem);
  static const std::string page = MakeContractPage();
  return HtmlAnswer(context, HttpBody::Static(page), kTextPagePolicy);
}

api::Outcome<HttpResponse> GetProblemPage(const HandlerContext& context, RoutedRequest& routed) {
  if (auto problem = api::CheckNoParameters(routed.http.query_string)) return *std::move(problem);
  const auto code = api::ParseErrorCode(routed.path_parameter);
  if (!code) {
    return Problem{.code = ErrorCode::kNotFound, .detail = "no problem has this code"};
  }
  const api::ErrorRow& row = api::RowOf(*code);
  const std::string body = "<h1>" + EscapeHtml(row.title) + "</h1>\n<p><code>" +
                           EscapeHtml(api::Name(row.code)) + "</code>, HTTP status " +
                           std::to_string(row.status) + "</p>\n<p>" + EscapeHtml(row.meaning) +
                           "</p>\n<p><a href=\"../docs#problems\">All problems</a></p>\n";
  return HtmlAnswer(context, TextPage(row.title, body), kTextPagePolicy);
}

}  // namespace kdray::server
