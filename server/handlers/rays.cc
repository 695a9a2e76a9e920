#include "server/handlers/rays.h"

#include <memory>
#include <string>
#include <utility>

#include "api/batch_codec.h"
#include "api/json_text.h"
#include "api/names.h"
#include "api/request_codec.h"
#include "server/handlers/answers.h"
#include "server/handlers/batch_memory.h"
#include "server/handlers/computation.h"

namespace kdray::server {
namespace {

/// One kind of query: how its answer is written, and the tree's method.
template <class Rows>
struct Query {
  using Writer = api::AnswerWriter<Rows>;
  std::unique_ptr<Writer> (*make_writer)(const api::RayTable& rays, const api::RayOptions& options,
                                         api::BatchType type, api::ChargeBytes charge);
  api::Outcome<api::BatchReport> (LoadedTree::*ask)(const api::RayTable& rays,
                                                    const api::RayOptions& options,
                                                    const CancelToken& cancel,
                                                    api::RowSink<Rows>* sink) const;
  bool truncates = false;  ///< rows may be cut
};

constexpr Query<api::ClosestRows> kClosest = {api::WriterOfClosest, &LoadedTree::Closest};
constexpr Query<api::AnyRows> kAny = {api::WriterOfAny, &LoadedTree::Any};
constexpr Query<api::CountRows> kCount = {api::WriterOfCount, &LoadedTree::Count};
constexpr Query<api::AllRows> kAll = {api::WriterOfAll, &LoadedTree::All, true};

template <class Rows>
api::Outcome<HttpResponse> AnswerBatch(const HandlerContext& context, RoutedRequest& routed,
                                       const api::Outcome<api::RayOptions>& decoded,
                                       const Query<Rows>& query) {
  if (!decoded) return decoded.problem();
  const api::RayOptions& options = *decoded;
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
  const LoadedTree& tree = *computation->tree;
  BatchMemory memory(std::move(body->share), body->text.size());

  const Stopwatch parsing;
  const api::BatchWork work{
      .should_stop = [&cancel = computation->cancel] { return cancel.ShouldStop(); },
      .run = [&tree](
                 std::size_t count,
                 const std::function<void(std::size_t)>& piece) { tree.RunPieces(count, piece); },
      .charge = memory.charge()};
  const auto rays = api::DecodeRays(body->text, *type, options, context.limits, work);
  if (!rays) return work.should_stop() ? limit.Explain(computation->WhyStopped()) : rays.problem();
  if (*type == api::BatchType::kJson) {  // the rows of an array are read where they lie
    memory.Return(body->text.size());
    body->text = GrowingBytes();
  }
  routed.timing.parse_ms = parsing.ms();

  const auto writer = query.make_writer(*rays, options, *answer_type, memory.charge());
  const auto report = (tree.*query.ask)(*rays, options, computation->cancel, writer.get());
  if (!report) return limit.Explain(report.problem());
  *routed.timing.parse_ms += report->parse_ms;
  routed.timing.trace_ms = report->trace_ms;
  routed.rows = rays->size();

  const Stopwatch finishing;
  auto pieces = std::move(*writer).Finish(*report);
  if (!pieces) return std::move(pieces).problem();
  HttpResponse response;
  std::uint64_t bytes = 0;
  for (const api::ByteBlock& piece : *pieces) bytes += piece.size();
  response.body = HttpBody(*std::move(pieces), std::move(memory).Keep(bytes));
  routed.timing.encode_ms = report->encode_ms + finishing.ms();
  response.headers.Add("Content-Type", api::ContentType(*answer_type));
  response.headers.Add("Vary", "Accept");
  response.headers.Add("Kdray-Precision", api::Name(report->precision));
  response.headers.Add("Kdray-Invalid", std::to_string(report->invalid.size()));
  if (query.truncates) {
    response.headers.Add("Kdray-Truncated", std::to_string(report->truncated.size()));
  }
  if (report->offset) response.headers.Add("Kdray-Offset", api::NumberText(*report->offset));
  SetCaching(response, context, Caching::kNever);
  return response;
}

}  // namespace

api::Outcome<HttpResponse> PostRaysClosest(const HandlerContext& context, RoutedRequest& routed) {
  return AnswerBatch(context, routed,
                     api::DecodeClosestOptions(routed.http.query_string, context.limits), kClosest);
}

api::Outcome<HttpResponse> PostRaysAny(const HandlerContext& context, RoutedRequest& routed) {
  return AnswerBatch(context, routed,
                     api::DecodeAnyOptions(routed.http.query_string, context.limits), kAny);
}

api::Outcome<HttpResponse> PostRaysCount(const HandlerContext& context, RoutedRequest& routed) {
  return AnswerBatch(context, routed,
                     api::DecodeCountOptions(routed.http.query_string, context.limits), kCount);
}

api::Outcome<HttpResponse> PostRaysAll(const HandlerContext& context, RoutedRequest& routed) {
  return AnswerBatch(context, routed,
                     api::DecodeAllOptions(routed.http.query_string, context.limits), kAll);
}

}  // namespace kdray::server
