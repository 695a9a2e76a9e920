#include "server/handlers/rays.h"

#include <string>
#include <utility>

#include "api/batch_codec.h"
#include "api/names.h"
#include "api/request_codec.h"
#include "server/handlers/answers.h"
#include "server/handlers/work.h"

namespace kdray::server {
namespace {

/// What the queries have in common. `trace(tree, rays, cancel)` asks the tree, `encode(answer,
/// rays, type, should_stop)` makes the bytes.
template <class Trace, class Encode>
api::Outcome<HttpResponse> AnswerBatch(const Services& services, Call& call,
                                       const api::RayOptions& options, const Trace& trace,
                                       const Encode& encode) {
  if (auto problem = services.backend.Find(call.name)) return *std::move(problem);
  auto body = ReadWholeBody(services, call, services.limits.MaxBatchBytes());
  if (!body) return std::move(body).problem();
  const HttpHeaders& headers = call.request.headers;
  const auto type = api::DetectBatchType(body->text, headers.Find("Content-Type"));
  if (!type) return type.problem();
  const auto answer_type = api::ChooseAnswerType(headers.Find("Accept"), *type);
  if (!answer_type) return answer_type.problem();

  const TimeLimit limit{.ms = options.deadline_ms,
                        .default_ms = api::RayOptions().deadline_ms,
                        .parameter = "deadline_ms"};
  const auto work = BeginWork(services, call, TreeUse::kRays, limit);
  if (!work) return work.problem();
  const api::ShouldStop should_stop = [&cancel = work->cancel] { return cancel.ShouldStop(); };
  const Stopwatch parsing;
  const auto rays = api::DecodeRays(body->text, *type, options, services.limits, should_stop);
  if (!rays) return should_stop() ? limit.Explain(work->WhyStopped()) : rays.problem();
  body->text = std::string();  // from here on the rows are enough
  call.timing.parse_ms = parsing.ms();

  const auto answer = trace(*work->tree, *rays, work->cancel);
  if (!answer) return limit.Explain(answer.problem());
  call.timing.trace_ms = answer->trace_ms;

  const Stopwatch encoding;
  std::string bytes = encode(*answer, *rays, *answer_type, should_stop);
  if (bytes.empty()) return limit.Explain(work->WhyStopped());
  HttpResponse response;
  response.body = std::move(bytes);
  call.timing.encode_ms = encoding.ms();
  response.headers.Add("Content-Type", api::ContentType(*answer_type));
  response.headers.Add("Vary", "Accept");
  response.headers.Add("Kdray-Precision", api::Name(answer->precision));
  response.headers.Add("Kdray-Invalid", std::to_string(answer->invalid.size()));
  SetCaching(response, services, Caching::kNever);
  return response;
}

}  // namespace

api::Outcome<HttpResponse> PostRaysClosest(const Services& services, Call& call) {
  const auto options = api::DecodeClosestOptions(call.request.query, services.limits);
  if (!options) return options.problem();
  return AnswerBatch(
      services, call, *options,
      [&](const LoadedTree& tree, const api::RayTable& rays, const CancelToken& cancel) {
        return tree.Closest(rays, *options, cancel);
      },
      [&](const api::ClosestAnswer& answer, const api::RayTable& rays, api::BatchType type,
          const api::ShouldStop& should_stop) {
        return api::EncodeClosest(answer, rays, *options, type, should_stop);
      });
}

api::Outcome<HttpResponse> PostRaysAny(const Services& services, Call& call) {
  const auto options = api::DecodeAnyOptions(call.request.query, services.limits);
  if (!options) return options.problem();
  return AnswerBatch(
      services, call, *options,
      [&](const LoadedTree& tree, const api::RayTable& rays, const CancelToken& cancel) {
        return tree.Any(rays, *options, cancel);
      },
      [](const api::AnyAnswer& answer, const api::RayTable& rays, api::BatchType type,
         const api::ShouldStop& should_stop) {
        return api::EncodeAny(answer, rays, type, should_stop);
      });
}

}  // namespace kdray::server
