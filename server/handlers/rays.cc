// SPDX-License-Identifier: Apache-2.0
#include "server/handlers/rays.h"

#include <memory>
#include <string>
#include <utility>

#include "api/batch_codec.h"
#include "api/json_text.h"
#include "api/request_codec.h"
#include "server/handlers/answers.h"
#include "server/handlers/batch_memory.h"
#include "server/handlers/computation.h"
#include "server/handlers/ray_body.h"
#include "server/release_pages.h"

namespace kdray::server {
namespace {

/// One kind of query: how its answer is written, and the tree's method.
template <class Rows>
struct Query {
  using Writer = api::AnswerWriter<Rows>;
  std::unique_ptr<Writer> (*make_writer)(const api::RayTable& rays, const api::RayOptions& options,
                                         api::BatchType type, api::ChargeBytes charge,
                                         api::BlockSource* blocks);
  api::Outcome<api::BatchReport> (LoadedTree::*ask)(const api::RayTable& rays,
                                                    const api::RayOptions& options,
                                                    const CancelToken& cancel,
                                                    api::RowSink<Rows>* sink) const;
  bool lists = false;  ///< an answer has lists of hits, which may be cut
};

constexpr Query<api::ClosestRows> kClosest = {api::WriterOfClosest, &LoadedTree::Closest};
constexpr Query<api::AnyRows> kAny = {api::WriterOfAny, &LoadedTree::Any};
constexpr Query<api::CountRows> kCount = {api::WriterOfCount, &LoadedTree::Count};
constexpr Query<api::AllRows> kAll = {api::WriterOfAll, &LoadedTree::All, true};

/// Gives the rows of an answer to its writer, and the memory of a large batch back block by block,
/// so that the answer takes its place.
template <class Rows>
class ReleasingSink final : public api::RowSink<Rows> {
 public:
  ReleasingSink(api::RayTable* rays, api::RowSink<Rows>* writer, BatchMemory* memory)
      : rays_(*rays), writer_(*writer), memory_(*memory) {}

  api::Check Begin(std::size_t elements) override { return writer_.Begin(elements); }
  void Put(const Rows& rows) override { writer_.Put(rows); }
  void HaveRead(std::size_t rows) override {
    if (rays_.blocks() != nullptr) return memory_.Return(rays_.FreeBlocks(rows));
    constexpr std::size_t kLargeBytes = std::size_t{4} << 20;
    const std::span<const char> read = rays_.MemoryOf(rows);
    if (read.size() < kLargeBytes) return;
    const std::size_t released = ReleasePages(read.subspan(released_));
    released_ = read.size();
    memory_.Return(released);
  }

 private:
  api::RayTable& rays_;
  api::RowSink<Rows>& writer_;
  BatchMemory& memory_;
  std::size_t released_ = 0;  ///< bytes before the next row, which is not aligned to a page
};

template <class Rows>
api::Outcome<HttpResponse> AnswerBatch(const HandlerContext& context, RoutedRequest& routed,
                                       const api::Outcome<api::RayOptions>& decoded,
                                       const Query<Rows>& query) {
  if (!decoded) return decoded.problem();
  const api::RayOptions& options = *decoded;
  if (auto problem = context.backend.Find(routed.path_parameter)) return *std::move(problem);
  const std::int64_t hits_per_ray = query.lists ? options.max_hits : 1;
  const WorkOfBody work_of_body = WorkOfRays(hits_per_ray);
  auto body = ReadRayBody(context, routed, options, work_of_body);
  if (!body) return std::move(body).problem();
  const HttpHeaders& headers = routed.http.headers;
  const auto type = body->rays ? api::Outcome<api::BatchType>(api::BatchType::kNpy)
                               : api::DetectBatchType(body->text, headers.Find("Content-Type"));
  if (!type) return type.problem();
  const auto answer_type = api::ChooseAnswerType(headers.Find("Accept"), *type);
  if (!answer_type) return answer_type.problem();

  const TimeLimit limit{.ms = options.deadline_ms,
                        .default_ms = api::RayOptions().deadline_ms,
                        .parameter = "deadline_ms"};
  const auto computation =
      BeginComputation(context, routed, TreeUse::kRays, limit, work_of_body(body->bytes));
  if (!computation) return computation.problem();
  const LoadedTree& tree = *computation->tree;
  BatchMemory memory(std::move(body->share),
                     query.lists ? api::ErrorCode::kTooManyHits : api::ErrorCode::kTooManyRays,
                     tree.bytes());

  const Stopwatch parsing;
  const api::BatchWork work{
      .should_stop = [&cancel = computation->cancel] { return cancel.ShouldStop(); },
      .run = [&tree](
                 std::size_t count,
                 const std::function<void(std::size_t)>& piece) { tree.RunPieces(count, piece); },
      .charge = memory.charge()};
  auto rays = body->rays ? api::Outcome<api::RayTable>(*std::move(body->rays))
                         : api::DecodeRays(body->text, *type, options, context.limits, work);
  if (!rays) return work.should_stop() ? limit.Explain(computation->WhyStopped()) : rays.problem();
  if (*type == api::BatchType::kJson) {  // the rows of an array are read where they lie
    memory.Return(body->text.size());
    body->text = GrowingBytes();
  }
  routed.timing.parse_ms = body->decode_ms + parsing.ms();

  const auto writer =
      query.make_writer(*rays, options, *answer_type, memory.charge(), context.memory.blocks());
  const std::uint64_t block_bytes = MemoryOfBlock(rays->size(), hits_per_ray);
  if (auto problem = memory.Charge(block_bytes)) return *std::move(problem);
  ReleasingSink<Rows> sink(&*rays, writer.get(), &memory);
  const auto report = (tree.*query.ask)(*rays, options, computation->cancel, &sink);
  if (!report) return limit.Explain(report.problem());
  *routed.timing.parse_ms += report->parse_ms;
  routed.timing.trace_ms = report->trace_ms;
  routed.rows = rays->size();
  *rays = {};
  body->text = {};

  const Stopwatch finishing;
  auto pieces = std::move(*writer).Finish(*report);
  if (!pieces) return std::move(pieces).problem();
  HttpResponse response;
  std::uint64_t bytes = 0;
  for (const api::ByteBlock& piece : *pieces) bytes += piece.capacity();
  response.body = HttpBody(*std::move(pieces), std::move(memory).Keep(bytes));
  routed.timing.encode_ms = report->encode_ms + finishing.ms();
  AddBatchHeaders(response, *answer_type, report->precision, report->invalid.size());
  if (query.lists) {
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
