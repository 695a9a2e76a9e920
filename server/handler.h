// What a handler takes: the context that all share, and its request with the times it reports.
#pragma once

#include <atomic>
#include <chrono>
#include <optional>
#include <string>
#include <string_view>

#include "api/limits.h"
#include "server/admission.h"
#include "server/backend.h"
#include "server/http/message.h"
#include "server/request_memory.h"

namespace kdray::server {

/// Milliseconds of the parts of an answer, for the Server-Timing header.
struct ServerTiming {
  double queue_ms = 0;
  std::optional<double> parse_ms, build_ms, trace_ms, encode_ms;

  std::string Format() const;
};

/// Milliseconds since it was made.
class Stopwatch {
 public:
  double ms() const {
    return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start_)
        .count();
  }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

/// What every handler may use; all of it safe from many threads at once.
struct HandlerContext {
  Backend& backend;
  const api::Limits& limits;
  Admission& admission;
  RequestMemory& memory;
  const std::atomic<bool>& draining;  ///< the daemon is about to end
  bool with_tokens = false;  ///< answers are for one client: caches between must not keep them
};

/// A request with what its route says of it, and the times that its handler reports.
struct RoutedRequest {
  const HttpRequest& http;
  std::string_view path_parameter;  ///< the segment of the path where the route has {…}
  ServerTiming timing;
};

using Handler = api::Outcome<HttpResponse> (*)(const HandlerContext&, RoutedRequest&);

}  // namespace kdray::server
