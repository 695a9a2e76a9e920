// SPDX-License-Identifier: Apache-2.0
#include "server/handlers/visibility.h"

#include <cstdint>
#include <string>
#include <utility>

#include "api/json_text.h"
#include "api/request_codec.h"
#include "api/visibility_codec.h"
#include "server/handlers/answers.h"
#include "server/handlers/batch_memory.h"
#include "server/handlers/computation.h"
#include "server/handlers/point_batch.h"

namespace kdray::server {
namespace {

// Upper bound of the bytes of a pair, beside those of a block of rays: the answer, and its text in
// JSON.
constexpr std::uint64_t kPairBytes = 8;

}  // namespace

api::Outcome<HttpResponse> PostVisibility(const HandlerContext& context, RoutedRequest& routed) {
  const auto options = api::DecodeVisibilityOptions(routed.http.query_string, context.limits);
  if (!options) return options.problem();
  const WorkOfBody work_of_body = WorkOfVisibility(*options, context.limits.max_rays);
  auto batch = ReadPointBatch(context, routed, work_of_body);
  if (!batch) return std::move(batch).problem();
  RequestBody& body = batch->body;
  if (auto problem = api::CheckAnswerType(*options, batch->answer_type)) return *std::move(problem);

  const TimeLimit limit{.ms = options->deadline_ms,
                        .default_ms = api::VisibilityOptions().deadline_ms,
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
  const auto sets =
      api::DecodePointSets(body.text, batch->type, *options, context.limits,
                           {.should_stop = should_stop, .run = {}, .charge = memory.charge()});
  if (!sets) return should_stop() ? limit.Explain(computation->WhyStopped()) : sets.problem();
  body.text = {};  // only the points are needed from here on
  memory.Return(body_bytes);
  routed.timing.parse_ms = parsing.ms();

  const std::uint64_t pairs = sets->from.size() * (sets->to.size() + 1);
  if (auto problem = memory.Charge(pairs * kPairBytes + MemoryOfBlock(pairs, 1))) {
    return *std::move(problem);
  }
  const auto answer = computation->tree->Visibility(*sets, *options, computation->cancel);
  if (!answer) return limit.Explain(answer.problem());
  routed.timing.trace_ms = answer->trace_ms;
  routed.rows = sets->from.size() * sets->to.size();

  const Stopwatch encoding;
  std::string bytes =
      api::EncodeVisibility(*answer, *sets, *options, batch->answer_type, should_stop);
  if (bytes.empty()) return limit.Explain(computation->WhyStopped());
  HttpResponse response;
  const std::uint64_t answer_bytes = bytes.size();
  response.body = std::move(bytes);
  response.body.Own(std::move(memory).Keep(answer_bytes));
  routed.timing.encode_ms = encoding.ms();
  AddBatchHeaders(response, batch->answer_type, answer->precision, answer->invalid.size());
  if (answer->offset) response.headers.Add("Kdray-Offset", api::NumberText(*answer->offset));
  SetCaching(response, context, Caching::kNever);
  return response;
}

}  // namespace kdray::server
