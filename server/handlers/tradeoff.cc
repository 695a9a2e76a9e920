// SPDX-License-Identifier: Apache-2.0
#include "server/handlers/tradeoff.h"

#include <chrono>
#include <cstdint>
#include <string>
#include <utility>

#include "api/answer_codec.h"
#include "api/request_codec.h"
#include "server/handlers/answers.h"

namespace kdray::server {
namespace {

/// The result, or the progress after the client's wait_ms.
api::Outcome<HttpResponse> AnswerWithin(const HandlerContext& context, const RoutedRequest& routed,
                                        std::int64_t wait_ms, Caching caching) {
  const auto cancel = CancelToken::Cancellable();
  const auto watch = routed.http.peer->CancelWhenGone(cancel);
  const auto tradeoff = context.backend.WaitForTradeoff(
      routed.path_parameter, std::chrono::steady_clock::now() + std::chrono::milliseconds(wait_ms),
      cancel);
  if (!tradeoff) return tradeoff.problem();
  HttpResponse response = JsonAnswer(tradeoff->ready ? 200 : 202, api::EncodeTradeoff(*tradeoff));
  SetCaching(response, context, caching);
  return response;
}

}  // namespace

api::Outcome<HttpResponse> PostTradeoff(const HandlerContext& context, RoutedRequest& routed) {
  const auto request = api::DecodeMeasure(routed.http.query_string, context.limits);
  if (!request) return request.problem();
  if (auto problem = RefuseBody(routed)) return *std::move(problem);
  if (auto problem = context.backend.Measure(routed.path_parameter)) return *std::move(problem);
  return AnswerWithin(context, routed, request->wait_ms, Caching::kNever);
}

api::Outcome<HttpResponse> GetTradeoff(const HandlerContext& context, RoutedRequest& routed) {
  const auto request = api::DecodeDescribe(routed.http.query_string, context.limits);
  if (!request) return request.problem();
  return AnswerWithin(context, routed, request->wait_ms, Caching::kRevalidate);
}

api::Outcome<HttpResponse> DeleteTradeoff(const HandlerContext& context, RoutedRequest& routed) {
  if (auto problem = api::CheckNoParameters(routed.http.query_string)) return *std::move(problem);
  if (auto problem = context.backend.ForgetTradeoff(routed.path_parameter))
    return *std::move(problem);
  HttpResponse response;
  response.status = 204;
  SetCaching(response, context, Caching::kNever);
  return response;
}

}  // namespace kdray::server
