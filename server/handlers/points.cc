// SPDX-License-Identifier: Apache-2.0
#include "server/handlers/points.h"

#include <cstdint>
#include <span>
#include <utility>

#include "api/point_codec.h"
#include "api/request_codec.h"
#include "server/handlers/answers.h"
#include "server/handlers/batch_memory.h"
#include "server/handlers/computation.h"
#include "server/handlers/point_batch.h"

namespace kdray::server {
namespace {

/// The common part of the queries; `ask` is the tree's method.
template <class Row>
api::Outcome<HttpResponse> AnswerPoints(
    const HandlerContext& context, RoutedRequest& routed,
    const api::Outcome<api::PointOptions>& options,
    api::Outcome<api::PointReport> (LoadedTree::*ask)(const api::PointTable&,
                                                      const api::PointOptions&, const CancelToken&,
                                                      const LoadedTree::PutRows<Row>&) const) {
  if (!options) return options.problem();
  const WorkOfBody work_of_body = WorkOfPoints();
  auto batch = ReadPointBatch(context, routed, work_of_body);
  if (!batch) return std::move(batch).problem();
  RequestBody& body = batch->body;

  const TimeLimit limit{.ms = options->deadline_ms,
                        .default_ms = api::PointOptions().deadline_ms,
                        .parameter = "deadline_ms"};
  const auto computation =
      BeginComputation(context, routed, TreeUse::kRays, limit, work_of_body(body.text.size()));
  if (!computation) return computation.problem();
  const api::ShouldStop should_stop = [&cancel = computation->cancel] {
    return cancel.ShouldStop();
  };
  const std::size_t body_bytes = body.text.size();
  BatchMemory memory(std::move(body.share), api::ErrorCode::kTooManyRays,
                     computation->tree->bytes());
  const Stopwatch parsing;
  const auto points =
      api::DecodePoints(body.text, batch->type, context.limits,
                        {.should_stop = should_stop, .run = {}, .charge = memory.charge()});
  if (!points) return should_stop() ? limit.Explain(computation->WhyStopped()) : points.problem();
  body.text = {};  // only the rows are needed from here on
  memory.Return(body_bytes);
  routed.timing.parse_ms = parsing.ms();

  if (auto problem = memory.Charge(MemoryOfBlock(points->size(), 1))) return *std::move(problem);
  double encode_ms = 0;
  api::Check full;
  api::PointWriter writer(*points, *options, batch->answer_type, memory.charge());
  const auto put = [&](std::span<const Row> rows) {
    if (full) return;
    const Stopwatch encoding;
    full = writer.Put(rows);
    encode_ms += encoding.ms();
    if (full) computation->cancel.Cancel();  // the rest of the answer is not needed
  };
  const auto report = (*computation->tree.*ask)(*points, *options, computation->cancel, put);
  if (full) return *std::move(full);
  if (!report) return limit.Explain(report.problem());
  routed.timing.trace_ms = report->trace_ms;
  routed.rows = points->size();

  const Stopwatch finishing;
  auto pieces = std::move(writer).Finish(report->invalid);
  if (!pieces) return std::move(pieces).problem();
  std::uint64_t bytes = 0;
  for (const api::ByteBlock& piece : *pieces) bytes += piece.size();
  HttpResponse response;
  response.body = HttpBody(*std::move(pieces), std::move(memory).Keep(bytes));
  routed.timing.encode_ms = encode_ms + finishing.ms();
  AddBatchHeaders(response, batch->answer_type, report->precision, report->invalid.size());
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
