// SPDX-License-Identifier: Apache-2.0
// The parameters of a handler: the common context, and its request with the times that it reports.
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
#include "server/log.h"
#include "server/metrics.h"
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

/// The services of every handler; all are safe from many threads at once.
struct HandlerContext {
  Backend& backend;
  const api::Limits& limits;
  Admission& admission;
  RequestMemory& memory;
  Metrics& metrics;
  const Log& log;
  const std::atomic<bool>& draining;     ///< the daemon is shutting down
  std::uint64_t memory_limit_bytes = 0;  ///< of the whole daemon, for the metrics
  bool with_tokens = false;  ///< answers are for one client: shared caches must not keep them
};

/// A request with its route's parameter, and the times that its handler reports.
struct RoutedRequest {
  const HttpRequest& http;
  std::string_view path_parameter;  ///< the segment of the path where the route has {…}
  ServerTiming timing;
  std::uint64_t rows = 0;  ///< that a query answered
};

using Handler = api::Outcome<HttpResponse> (*)(const HandlerContext&, RoutedRequest&);

}  // namespace kdray::server
