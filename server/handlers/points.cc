#include "server/handlers/points.h"

#include <cstdint>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "api/names.h"
#include "api/point_codec.h"
#include "api/request_codec.h"
#include "server/handlers/answers.h"
#include "server/handlers/computation.h"

namespace kdray::server {
namespace {

/// The memory of a query's rows and of its answer, which grows.
class AnswerMemory {
 public:
  explicit AnswerMemory(RequestMemory& memory) : memory_(memory) {}

  /// Charges what is missing of `bytes`; memory_full if that is not free now.
  api::Check Cover(std::uint64_t bytes) {
    if (bytes <= charged_) return std::nullopt;
    auto share = memory_.Take(bytes - charged_);
    if (!share) return std::move(share).problem();
    shares_.push_back(*std::move(share));
    charged_ = bytes;
    return std::nullopt;
  }

 private:
  RequestMemory& memory_;
  std::vector<RequestMemory::Share> shares_;
  std::uint64_t charged_ = 0;
};

/// The common part of the queries; `ask` is the tree's method.
template <class Row>
api::Outcome<HttpResponse> AnswerPoints(
    const HandlerContext& context, RoutedRequest& routed,
    const api::Outcome<api::PointOptions>& options,
    api::Outcome<api::PointReport> (LoadedTree::*ask)(const api::PointTable&,
                                                      const api::PointOptions&, const CancelToken&,
                                                      const LoadedTree::PutRows<Row>&) const) {
  if (!options) return options.problem();
  if (auto problem = context.backend.Find(routed.path_parameter)) return *std::move(problem);
  auto body = ReadWholeBody(context, routed, context.limits.MaxBatchBytes());
  if (!body) return std::move(body).problem();
  const HttpHeaders& headers = routed.http.headers;
  const auto type = api::DetectBatchType(body->text, headers.Find("Content-Type"));
  if (!type) return type.problem();
  const auto answer_type = api::ChooseAnswerType(headers.Find("Accept"), *type);
  if (!answer_type) return answer_type.problem();

  const TimeLimit limit{.ms = options->deadline_ms,
                        .default_ms = api::PointOptions().deadline_ms,
                        .parameter = "deadline_ms"};
  const auto computation = BeginComputation(context, routed, TreeUse::kRays, limit);
  if (!computation) return computation.problem();
  const api::ShouldStop should_stop = [&cancel = computation->cancel] {
    return cancel.ShouldStop();
  };
  const Stopwatch parsing;
  const auto points = api::DecodePoints(body->text, *type, context.limits, should_stop);
  if (!points) return should_stop() ? limit.Explain(computation->WhyStopped()) : points.problem();
  body->text = {};  // only the rows are needed from here on
  routed.timing.parse_ms = parsing.ms();

  AnswerMemory memory(context.memory);
  if (auto problem = memory.Cover(points->size() * sizeof(api::Vec3))) return *std::move(problem);
  double encode_ms = 0;
  api::Check full;
  api::PointWriter writer(*points, *options, *answer_type);
  const auto put = [&](std::span<const Row> rows) {
    if (full) return;
    const Stopwatch encoding;
    writer.Put(rows);
    encode_ms += encoding.ms();
    full = memory.Cover(points->size() * sizeof(api::Vec3) + writer.memory_bytes());
    if (full) computation->cancel.Cancel();  // the rest of the answer is not needed
  };
  const auto report = (*computation->tree.*ask)(*points, *options, computation->cancel, put);
  if (full) return *std::move(full);
  if (!report) return limit.Explain(report.problem());
  routed.timing.trace_ms = report->trace_ms;
  routed.rows = points->size();

  const Stopwatch finishing;
  HttpResponse response;
  response.body = std::move(writer).Finish(report->invalid);
  routed.timing.encode_ms = encode_ms + finishing.ms();
  response.headers.Add("Content-Type", api::ContentType(*answer_type));
  response.headers.Add("Vary", "Accept");
  response.headers.Add("Kdray-Precision", api::Name(report->precision));
  response.headers.Add("Kdray-Invalid", std::to_string(report->invalid.size()));
  SetCaching(response, context, Caching::kNever);
  return response;
}

}  // namespace

api::Outcome<HttpResponse> PostPointsClosest(const HandlerContext& context, RoutedRequest& routed) {
  return AnswerPoints(context, routed,
                      api::DecodeClosestPointOptions(routed.http.query_string, context.limits),
                      &LoadedTree::ClosestPoints);
}

api::Outcome<HttpResponse> PostPointsSignedDistance(const HandlerContext& context,
                                                    RoutedRequest& routed) {
  return AnswerPoints(context, routed,
                      api::DecodeSideOptions(routed.http.query_string, context.limits),
                      &LoadedTree::SignedDistances);
}

api::Outcome<HttpResponse> PostPointsInside(const HandlerContext& context, RoutedRequest& routed) {
  return AnswerPoints(context, routed,
                      api::DecodeSideOptions(routed.http.query_string, context.limits),
                      &LoadedTree::Inside);
}

}  // namespace kdray::server
