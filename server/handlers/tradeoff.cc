#include "server/handlers/tradeoff.h"

#include <chrono>
#include <cstdint>
#include <string>
#include <utility>

#include "api/request_codec.h"
#include "api/tradeoff_codec.h"
#include "server/handlers/answers.h"

namespace kdray::server {
namespace {

/// The result, or how far it is when the client has waited long enough.
api::Outcome<HttpResponse> AnswerWithin(const Services& services, const Call& call,
                                        std::int64_t wait_ms, Caching caching) {
  const auto cancel = CancelToken::Cancellable();
  const auto watch = call.request.peer->CancelWhenGone(cancel);
  const auto tradeoff = services.backend.WaitForTradeoff(
      call.name, std::chrono::steady_clock::now() + std::chrono::milliseconds(wait_ms), cancel);
  if (!tradeoff) return tradeoff.problem();
  HttpResponse response = JsonAnswer(tradeoff->ready ? 200 : 202, api::EncodeTradeoff(*tradeoff));
  SetCaching(response, services, caching);
  return response;
}

}  // namespace

api::Outcome<HttpResponse> PostTradeoff(const Services& services, Call& call) {
  const auto request = api::DecodeMeasure(call.request.query, services.limits);
  if (!request) return request.problem();
  if (auto problem = RefuseBody(call)) return *std::move(problem);
  if (auto problem = services.backend.Measure(call.name)) return *std::move(problem);
  return AnswerWithin(services, call, request->wait_ms, Caching::kNever);
}

api::Outcome<HttpResponse> GetTradeoff(const Services& services, Call& call) {
  const auto request = api::DecodeDescribe(call.request.query, services.limits);
  if (!request) return request.problem();
  return AnswerWithin(services, call, request->wait_ms, Caching::kRevalidate);
}

api::Outcome<HttpResponse> DeleteTradeoff(const Services& services, Call& call) {
  if (auto problem = api::CheckNoParameters(call.request.query)) return *std::move(problem);
  if (auto problem = services.backend.ForgetTradeoff(call.name)) return *std::move(problem);
  HttpResponse response;
  response.status = 204;
  SetCaching(response, services, Caching::kNever);
  return response;
}

}  // namespace kdray::server
