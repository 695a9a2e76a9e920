#include "server/handlers/rays.h"

#include <string>
#include <utility>

#include "api/batch_codec.h"
#include "api/names.h"
#include "api/request_codec.h"
#include "server/handlers/answers.h"
#include "server/handlers/computation.h"

namespace kdray::server {
namespace {

/// The common part of the queries. `trace(tree, rays, cancel)` queries the tree, `encode(answer,
/// rays, type, should_stop)` makes the bytes.
template <class Trace, class Encode>
api::Outcome<HttpResponse> AnswerBatch(const HandlerContext& context, RoutedRequest& routed,
                                       const api::RayOptions& options, const Trace& trace,
                                       const Encode& encode) {
  if (auto problem = context.backend.Find(routed.path_parameter)) return *std::move(problem);
  auto body = ReadWholeBody(context, routed, context.limits.MaxBatchBytes());
  if (!body) return std::move(body).problem();
  const HttpHeaders& headers = routed.http.headers;
  const auto type = api::DetectBatchType(body->text, headers.Find("Content-Type"));
  if (!type) return type.problem();
  const auto answer_type = api::ChooseAnswerType(headers.Find("Accept"), *type);
  if (!answer_type) return answer_type.problem();

  const TimeLimit limit{.ms = options.deadline_ms,
                        .default_ms = api::RayOptions().deadline_ms,
                        .parameter = "deadline_ms"};
  const auto computation = BeginComputation(context, routed, TreeUse::kRays, limit);
  if (!computation) return computation.problem();
  const api::ShouldStop should_stop = [&cancel = computation->cancel] {
    return cancel.ShouldStop();
  };
  const Stopwatch parsing;
  const auto rays = api::DecodeRays(body->text, *type, options, context.limits, should_stop);
  if (!rays) return should_stop() ? limit.Explain(computation->WhyStopped()) : rays.problem();
  body->text = std::string();  // only the rows are needed from here on
  routed.timing.parse_ms = parsing.ms();

  const auto answer = trace(*computation->tree, *rays, computation->cancel);
  if (!answer) return limit.Explain(answer.problem());
  routed.timing.trace_ms = answer->trace_ms;
  routed.rows = rays->size();

  const Stopwatch encoding;
  std::string bytes = encode(*answer, *rays, *answer_type, should_stop);
  if (bytes.empty()) return limit.Explain(computation->WhyStopped());
  HttpResponse response;
  response.body = std::move(bytes);
  routed.timing.encode_ms = encoding.ms();
  response.headers.Add("Content-Type", api::ContentType(*answer_type));
  response.headers.Add("Vary", "Accept");
  response.headers.Add("Kdray-Precision", api::Name(answer->precision));
  response.headers.Add("Kdray-Invalid", std::to_string(answer->invalid.size()));
  SetCaching(response, context, Caching::kNever);
  return response;
}

}  // namespace

api::Outcome<HttpResponse> PostRaysClosest(const HandlerContext& context, RoutedRequest& routed) {
  const auto options = api::DecodeClosestOptions(routed.http.query_string, context.limits);
  if (!options) return options.problem();
  return AnswerBatch(
      context, routed, *options,
      [&](const LoadedTree& tree, const api::RayTable& rays, const CancelToken& cancel) {
        return tree.Closest(rays, *options, cancel);
      },
      [&](const api::ClosestAnswer& answer, const api::RayTable& rays, api::BatchType type,
          const api::ShouldStop& should_stop) {
        return api::EncodeClosest(answer, rays, *options, type, should_stop);
      });
}

api::Outcome<HttpResponse> PostRaysAny(const HandlerContext& context, RoutedRequest& routed) {
  const auto options = api::DecodeAnyOptions(routed.http.query_string, context.limits);
  if (!options) return options.problem();
  return AnswerBatch(
      context, routed, *options,
      [&](const LoadedTree& tree, const api::RayTable& rays, const CancelToken& cancel) {
        return tree.Any(rays, *options, cancel);
      },
      [](const api::AnyAnswer& answer, const api::RayTable& rays, api::BatchType type,
         const api::ShouldStop& should_stop) {
        return api::EncodeAny(answer, rays, type, should_stop);
      });
}

}  // namespace kdray::server
