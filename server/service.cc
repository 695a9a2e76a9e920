// SPDX-License-Identifier: Apache-2.0
#include "server/service.h"

#include <algorithm>
#include <cstdint>
#include <random>
#include <utility>

#include "api/answer_codec.h"
#include "core/base/hex.h"
#include "server/content_decoder.h"
#include "server/log_query.h"

namespace kdray::server {
namespace {

using api::ErrorCode;
using api::Problem;

/// What a client may choose is short and cannot be mistaken for anything else in a log.
bool IsRequestId(std::string_view text) {
  return !text.empty() && text.size() <= 64 && std::all_of(text.begin(), text.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '.' ||
           c == '_' || c == '-';
  });
}

std::string MakeRequestId() {
  thread_local std::mt19937_64 random{std::random_device{}()};
  std::string id;
  for (std::uint64_t bits = random(); id.size() < 16; bits >>= 8) {
    core::AppendHex(static_cast<std::uint8_t>(bits), &id);
  }
  return id;
}

std::string RequestIdOf(const HttpRequest& request) {
  const auto given = request.headers.Find("X-Request-Id");
  return given && IsRequestId(*given) ? std::string(*given) : MakeRequestId();
}

/// What every answer says.
void AddCommonHeaders(HttpResponse& response, const std::string& request_id,
                      const ServerTiming& timing) {
  response.headers.Set("Kdray-Version", KDRAY_VERSION);
  response.headers.Set("X-Request-Id", request_id);
  response.headers.Set("Server-Timing", timing.Format());
  response.headers.Set("X-Content-Type-Options", "nosniff");
}

HttpResponse ProblemAnswer(const Problem& problem, const std::string& request_id) {
  const api::ErrorRow& row = api::RowOf(problem.code);
  HttpResponse response;
  response.status = row.status;
  response.error_code = api::Name(row.code);
  response.body = api::EncodeProblem(problem, request_id);
  response.headers.Add("Content-Type", api::kProblemContentType);
  response.headers.Add("Cache-Control", "no-store");
  if (row.retry_after_s != 0) {
    response.headers.Add("Retry-After", std::to_string(row.retry_after_s));
  }
  if (problem.code == ErrorCode::kUnauthorized) {
    response.headers.Add("WWW-Authenticate", "Bearer");
  }
  return response;
}

/// Only uploads have codings; their handler undoes them.
api::Check CheckContentEncoding(const HttpRequest& request, const RouteMatch& match) {
  const auto coding = request.headers.Find("Content-Encoding");
  if (!coding) return std::nullopt;
  const bool takes_codings = match.handler == match.route->post && match.route->takes_codings;
  if (request.headers.Count("Content-Encoding") == 1) {
    if (coding->empty() || EqualsIgnoringCase(*coding, "identity")) return std::nullopt;
    if (takes_codings && ParseContentCoding(*coding)) return std::nullopt;
  }
  return Problem{.code = ErrorCode::kUnsupportedEncoding,
                 .detail = takes_codings
                               ? "Content-Encoding must be one of gzip and zstd, or absent"
                               : "this path takes no Content-Encoding; POST /v1/trees "
                                 "takes gzip and zstd",
                 .parameter = "Content-Encoding"};
}

}  // namespace

Service::Service(ServiceOptions options, Backend& backend, const Log& log)
    : options_(std::move(options)),
      log_(log),
      admission_(options_.max_running, options_.max_queued, options_.short_factor),
      memory_(options_.request_memory_bytes, options_.memory_lender),
      metrics_(options_.routes, backend.counters().shared.has_value()),
      context_{.backend = backend,
               .limits = options_.limits,
               .admission = admission_,
               .memory = memory_,
               .metrics = metrics_,
               .log = log_,
               .draining = draining_,
               .memory_limit_bytes = options_.memory_limit_bytes,
               .with_tokens = options_.tokens.has_value()} {
  if (options_.tokens) tokens_.emplace(*options_.tokens);
}

HttpResponse Service::Handle(const HttpRequest& request) {
  const std::string request_id = RequestIdOf(request);
  ServerTiming timing;
  // Before the token: a browser sends none with it.
  if (auto preflight = options_.cors.AnswerPreflight(request)) {
    AddCommonHeaders(*preflight, request_id, timing);
    options_.cors.AddHeaders(request, *preflight);
    return *std::move(preflight);
  }
  std::string_view route;
  const RouteMatch match = FindRoute(options_.routes, request.method, request.path);
  auto answer = Answer(request, match, timing, route);
  HttpResponse response = answer ? *std::move(answer) : ProblemAnswer(answer.problem(), request_id);
  if (!answer && answer.problem().code == ErrorCode::kDraining && !draining_) {
    // Work was cancelled, and this server goes on. No client is told to come back later for that.
    response = ProblemAnswer(
        {.code = ErrorCode::kInternal, .detail = "the request could not be finished"}, request_id);
    response.cause = "the work was cancelled, but neither the client nor the server has ended";
  }
  if (!answer && answer.problem().code == ErrorCode::kMethodNotAllowed) {
    response.headers.Add("Allow", Allow(*match.route));
  }
  response.route = route;
  AddCommonHeaders(response, request_id, timing);
  options_.cors.AddHeaders(request, response);
  return response;
}

api::Outcome<HttpResponse> Service::Answer(const HttpRequest& request, const RouteMatch& match,
                                           ServerTiming& timing, std::string_view& route) {
  const bool open = match.route != nullptr && match.route->open;
  if (!open && !IsAllowed(request)) {
    return Problem{.code = ErrorCode::kUnauthorized,
                   .detail = "send 'Authorization: Bearer TOKEN' with a token of this server"};
  }
  if (match.route == nullptr) {
    return Problem{.code = ErrorCode::kNotFound,
                   .detail = "this path does not exist; /openapi.json lists the paths"};
  }
  if (match.handler == nullptr) {
    return Problem{.code = ErrorCode::kMethodNotAllowed,
                   .detail = "this path takes " + Allow(*match.route)};
  }
  if (!open && draining_ && !request.came_before_drain) {
    return Problem{.code = ErrorCode::kDraining, .detail = "this server is shutting down"};
  }
  if (auto problem = CheckContentEncoding(request, match)) return *std::move(problem);
  route = match.route->Label();
  RoutedRequest routed{.http = request, .path_parameter = match.path_parameter, .timing = {}};
  auto answer = match.handler(context_, routed);
  timing = routed.timing;
  if (routed.rows > 0 && answer) {
    metrics_.CountRows(match.route->path,
                       answer->headers.Find("Kdray-Precision").value_or(std::string_view()),
                       routed.rows);
  }
  return answer;
}

bool Service::IsAllowed(const HttpRequest& request) const {
  if (!tokens_) return true;
  // A proxy in front may have checked either of two headers, so only one is allowed.
  return request.headers.Count("Authorization") == 1 &&
         tokens_->Allows(request.headers.Find("Authorization"));
}

HttpResponse Service::Refuse(const HttpRequest& request, const Problem& problem) {
  const std::string request_id = RequestIdOf(request);
  HttpResponse response = ProblemAnswer(problem, request_id);
  AddCommonHeaders(response, request_id, {});
  options_.cors.AddHeaders(request, response);
  return response;
}

void Service::Answered(const HttpRecord& record) noexcept {
  if (record.status == kClientGone) ++clients_gone_;
  metrics_.Answered(record);
  const LogLevel level = record.status < 500    ? LogLevel::kInfo
                         : record.status == 503 ? LogLevel::kWarning
                                                : LogLevel::kError;
  if (!log_.Takes(level)) return;
  const std::string query = LoggedQuery(record.query_string);
  log_.Write(level, "request",
             {{"method", record.method},
              {"path", record.path},
              {"query", query},
              {"status", static_cast<std::uint64_t>(record.status)},
              {"code", record.error_code},
              {"ms", record.ms},
              {"bytes_in", record.bytes_in},
              {"bytes_out", record.bytes_out},
              {"complete", record.complete},
              {"remote", record.remote_addr},
              {"request_id", record.request_id},
              {"trace_id", record.trace_id},
              {"parent_id", record.parent_id},
              {"cause", record.cause}});
}

}  // namespace kdray::server
