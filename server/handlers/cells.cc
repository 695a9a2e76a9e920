// SPDX-License-Identifier: Apache-2.0
#include "server/handlers/cells.h"

#include <cstdint>
#include <memory>
#include <string>
#include <utility>

#include "api/answer_codec.h"
#include "api/request_codec.h"
#include "server/handlers/answers.h"
#include "server/handlers/computation.h"

namespace kdray::server {
namespace {

/// Cells have no deadline_ms of their own; theirs is the default of the queries.
constexpr TimeLimit kTimeLimit{.ms = 30000, .default_ms = 30000, .parameter = {}};

}  // namespace

api::Outcome<HttpResponse> GetCells(const HandlerContext& context, RoutedRequest& routed) {
  const auto request = api::DecodeCells(routed.http.query_string, context.limits);
  if (!request) return request.problem();
  if (auto problem = context.backend.Find(routed.path_parameter)) return *std::move(problem);
  const std::string etag = MakeEtag("cells", routed.path_parameter, api::CanonicalQuery(*request));
  if (ClientHas(routed.http, etag)) return NotModified(context, etag, Caching::kHour);

  const auto computation =
      BeginComputation(context, routed, TreeUse::kCells, kTimeLimit, kWorkOfCells);
  if (!computation) return computation.problem();
  auto memory = context.memory.Take(MemoryOfCells(*request, context.limits.max_cells),
                                    api::ErrorCode::kTooManyCells, computation->tree->bytes());
  if (!memory) return memory.problem();
  const Stopwatch tracing;
  const auto cells =
      computation->tree->Cells(static_cast<std::uint32_t>(request->depth), computation->cancel);
  if (!cells) return kTimeLimit.Explain(cells.problem());
  routed.timing.trace_ms = tracing.ms();

  const Stopwatch encoding;
  HttpResponse response = JsonAnswer(200, api::EncodeCells(*cells));
  memory->ShrinkTo(response.body.size());
  response.body.Own(std::make_shared<const RequestMemory::Share>(*std::move(memory)));
  routed.timing.encode_ms = encoding.ms();
  response.headers.Add("ETag", etag);
  SetCaching(response, context, Caching::kHour);
  return response;
}

}  // namespace kdray::server
