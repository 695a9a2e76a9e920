#include "server/handlers/cells.h"

#include <cstdint>
#include <string>

#include "api/answer_codec.h"
#include "api/request_codec.h"
#include "server/handlers/answers.h"
#include "server/handlers/work.h"

namespace kdray::server {
namespace {

/// Cells have no deadline_ms of their own; theirs is the default of the queries.
constexpr TimeLimit kTimeLimit{.ms = 30000, .default_ms = 30000, .parameter = {}};

}  // namespace

api::Outcome<HttpResponse> GetCells(const Services& services, Call& call) {
  const auto request = api::DecodeCells(call.request.query, services.limits);
  if (!request) return request.problem();
  if (auto problem = services.backend.Find(call.name)) return *std::move(problem);
  const std::string etag = MakeEtag("cells", call.name, api::CanonicalQuery(*request));
  if (ClientHas(call.request, etag)) return NotModified(services, etag, Caching::kHour);

  const auto work = BeginWork(services, call, TreeUse::kCells, kTimeLimit);
  if (!work) return work.problem();
  const Stopwatch tracing;
  const auto cells = work->tree->Cells(static_cast<std::uint32_t>(request->depth), work->cancel);
  if (!cells) return kTimeLimit.Explain(cells.problem());
  call.timing.trace_ms = tracing.ms();

  const Stopwatch encoding;
  HttpResponse response = JsonAnswer(200, api::EncodeCells(*cells));
  call.timing.encode_ms = encoding.ms();
  response.headers.Add("ETag", etag);
  SetCaching(response, services, Caching::kHour);
  return response;
}

}  // namespace kdray::server
