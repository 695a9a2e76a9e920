// SPDX-License-Identifier: Apache-2.0
// Sends the same request again and again for some time and measures the answers.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <vector>

#include "kdray/client.h"

namespace kdray::client {

/// Durations of single exchanges, from the request to the whole answer.
struct LoadResult {
  std::vector<double> latencies_ms;  ///< ascending
  std::vector<double> trace_ms;      ///< ascending; what the server says that tracing took
  double seconds = 0;                ///< of the whole run

  /// The value below which that share of the sorted values lies; 0 without values.
  static double Percentile(const std::vector<double>& sorted, double share);

  /// Answers a second.
  double Rate() const;
};

/// Runs `ask` on `connections` clients at the same time, each with one request under way, until
/// `duration` has passed; the first exchange of each connection is not counted. At least one is.
/// Throws what `ask` throws first.
LoadResult RunLoad(const ClientOptions& options, int connections,
                   std::chrono::duration<double> duration,
                   const std::function<Answer(Client&)>& ask);

}  // namespace kdray::client
