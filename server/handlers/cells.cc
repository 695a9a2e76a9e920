#include "server/handlers/cells.h"

#include <cstdint>
#include <string>

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

  const auto computation = BeginComputation(context, routed, TreeUse::kCells, kTimeLimit);
  if (!computation) return computation.problem();
  const Stopwatch tracing;
  const auto cells =
      computation->tree->Cells(static_cast<std::uint32_t>(request->depth), computation->cancel);
  if (!cells) return kTimeLimit.Explain(cells.problem());
  routed.timing.trace_ms = tracing.ms();

  const Stopwatch encoding;
  HttpResponse response = JsonAnswer(200, api::EncodeCells(*cells));
  routed.timing.encode_ms = encoding.ms();
  response.headers.Add("ETag", etag);
  SetCaching(response, context, Caching::kHour);
  return response;
}

}  // namespace kdray::server
