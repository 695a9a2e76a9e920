// SPDX-License-Identifier: Apache-2.0
// What the daemon counts about itself, for GET /metrics. Its .cc and server/current_metrics.h are
// the only files that include prometheus-cpp.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "server/backend.h"
#include "server/http/message.h"
#include "server/process_values.h"

namespace kdray::server {

struct Route;

/// Values that are read when the metrics are asked for, from those who keep them.
struct CurrentValues {
  BackendCounters backend;
  std::size_t running = 0, queued = 0;  ///< requests with a turn, and in the queue before it
  std::uint64_t request_memory_bytes = 0;
  std::uint64_t memory_limit_bytes = 0;  ///< of the whole daemon; 0: unknown
  std::uint64_t dropped_log_lines = 0;
  ProcessValues process;
};

/// Counters and histograms. Every label comes from a closed set, so there are at most kMaxSeries
/// lines in an answer, whatever clients send. Safe from many threads at once.
class Metrics {
 public:
  static constexpr std::size_t kMaxSeries = 200;
  /// Lines of kdray_http_requests_total. A pair of route and status gets its line when it first
  /// occurs. When this many are there, the route of a new pair is "other".
  static constexpr std::size_t kMaxRequestSeries = 78;
  /// Lines of a shared store; with one, there are fewer for pairs.
  static constexpr std::size_t kSharedStoreSeries = 27;
  static constexpr std::string_view kContentType = "text/plain; version=0.0.4; charset=utf-8";

  /// The routes' texts must outlive this. `has_shared_store`: values may have those of one.
  explicit Metrics(std::span<const Route> routes, bool has_shared_store = false);
  ~Metrics();
  Metrics(const Metrics&) = delete;
  Metrics& operator=(const Metrics&) = delete;

  /// One answered request. `record.route` is the template of a route, or empty.
  void Answered(const HttpRecord& record) noexcept;
  void ConnectionOpened() noexcept;
  void ConnectionClosed() noexcept;
  void ConnectionDropped(DropReason reason) noexcept;
  void AcceptFailed() noexcept;
  /// A request got its turn after this time in the queue.
  void GotTurn(double waited_ms) noexcept;
  /// A query answered `rows` rows in `precision`, by its name in the contract. `route` is a route's
  /// template; nothing is counted for routes without queries.
  void CountRows(std::string_view route, std::string_view precision, std::uint64_t rows) noexcept;
  /// The rays of a picture, by kind.
  void CountPicture(const api::RenderCounts& counts) noexcept;

  /// All of them in the text format 0.0.4 of Prometheus.
  std::string Text(const CurrentValues& now) const;

 private:
  class Impl;
  const std::unique_ptr<Impl> impl_;
};

}  // namespace kdray::server
