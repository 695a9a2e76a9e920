// SPDX-License-Identifier: Apache-2.0
#include "server/metrics.h"

#include <prometheus/counter.h>
#include <prometheus/gauge.h>
#include <prometheus/histogram.h>
#include <prometheus/registry.h>
#include <prometheus/text_serializer.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <mutex>
#include <optional>
#include <sstream>
#include <utility>
#include <vector>

#include "api/errors.h"
#include "api/names.h"
#include "server/current_metrics.h"
#include "server/routes.h"

namespace kdray::server {
namespace {

using prometheus::Counter;
using prometheus::Gauge;
using prometheus::Histogram;
using prometheus::Registry;

/// Seconds. Few, because each is a line for each class.
const Histogram::BucketBoundaries kSeconds = {0.001, 0.005, 0.025, 0.1, 0.5, 2.5, 10};

constexpr std::string_view kNoRoute = "none", kOtherRoute = "other";

/// Every status that an answer may have.
std::vector<int> AllStatuses() {
  std::vector<int> statuses = {200, 201, 202, 204, 304, kClientGone};
  for (const api::ErrorRow& row : api::ErrorTable()) statuses.push_back(row.status);
  std::sort(statuses.begin(), statuses.end());
  statuses.erase(std::unique(statuses.begin(), statuses.end()), statuses.end());
  return statuses;
}

/// The classes of requests whose times are kept apart.
enum class RequestClass : std::uint8_t { kOther, kQuery, kRender, kUpload };
constexpr std::array kClassNames = {
    std::pair(RequestClass::kOther, "other"), std::pair(RequestClass::kQuery, "query"),
    std::pair(RequestClass::kRender, "render"), std::pair(RequestClass::kUpload, "upload")};

constexpr std::array kDropNames = {std::pair(DropReason::kEvicted, "evicted"),
                                   std::pair(DropReason::kRefused, "refused"),
                                   std::pair(DropReason::kClosed, "closed")};

constexpr std::string_view kRaysPrefix = "/v1/trees/{id}/rays/";
constexpr std::string_view kPointsPrefix = "/v1/trees/{id}/points/";
constexpr std::string_view kVisibility = "/v1/trees/{id}/visibility";

RequestClass ClassOf(const HttpRecord& record) {
  const std::string_view route = record.route;
  if (route.starts_with(kRaysPrefix) || route.starts_with(kPointsPrefix) || route == kVisibility) {
    return RequestClass::kQuery;
  }
  if (route.starts_with("/v1/trees/{id}/render.")) return RequestClass::kRender;
  // GET lists trees.
  if (route == "/v1/trees" && record.method == "POST") return RequestClass::kUpload;
  return RequestClass::kOther;
}

Counter& AddCounter(Registry& registry, const char* name, const char* help) {
  return prometheus::BuildCounter().Name(name).Help(help).Register(registry).Add({});
}

/// Requests by route and status.
class RequestCounters {
 public:
  RequestCounters(Registry& registry, std::span<const Route> routes, std::size_t most_series)
      : most_series_(most_series),
        family_(prometheus::BuildCounter()
                    .Name("kdray_http_requests_total")
                    .Help("Answered requests, by the route whose handler answered and the status. "
                          "Route none: refused before a handler was called. Status 499: the client "
                          "left before the answer. Route other: further pairs of both.")
                    .Register(registry)),
        statuses_(AllStatuses()) {
    for (const Route& route : routes) {
      if (std::find(routes_.begin(), routes_.end(), route.Label()) == routes_.end()) {
        routes_.push_back(route.Label());
      }
    }
    routes_.push_back(kNoRoute);
    routes_.push_back(kOtherRoute);
    counters_ = std::vector<std::atomic<Counter*>>(routes_.size() * statuses_.size());
  }

  void Count(std::string_view route, int status) {
    const auto row = static_cast<std::size_t>(
        std::find(routes_.begin(), routes_.end(), route.empty() ? kNoRoute : route) -
        routes_.begin());
    auto column = static_cast<std::size_t>(
        std::lower_bound(statuses_.begin(), statuses_.end(), status) - statuses_.begin());
    if (column == statuses_.size() || statuses_[column] != status) return Count(route, 500);
    Of(std::min(row, routes_.size() - 1), column).Increment();
  }

 private:
  Counter& Of(std::size_t row, std::size_t column) {
    std::atomic<Counter*>& place = counters_[row * statuses_.size() + column];
    if (Counter* const counter = place.load(std::memory_order_acquire)) return *counter;
    const std::lock_guard lock(mutex_);
    if (Counter* const counter = place.load(std::memory_order_relaxed)) return *counter;
    const std::size_t other = routes_.size() - 1;
    // The places of route "other" are kept free, one for each status.
    if (row != other && exact_ + statuses_.size() == most_series_) {
      std::atomic<Counter*>& rest = counters_[other * statuses_.size() + column];
      if (rest == nullptr) rest = &Add(other, column);
      place = rest.load();
      return *place;
    }
    if (row != other) ++exact_;
    place = &Add(row, column);
    return *place;
  }
  Counter& Add(std::size_t row, std::size_t column) {
    return family_.Add(
        {{"route", std::string(routes_[row])}, {"status", std::to_string(statuses_[column])}});
  }

  const std::size_t most_series_;
  prometheus::Family<Counter>& family_;
  std::vector<std::string_view> routes_;  ///< the last one is "other"
  const std::vector<int> statuses_;
  std::vector<std::atomic<Counter*>> counters_;  ///< [route][status]; null: not seen yet
  std::mutex mutex_;
  std::size_t exact_ = 0;  ///< pairs with a line of their own, except those of route "other"
};

/// Rows of batches by query and precision. All lines are there from the start.
class RowCounters {
 public:
  RowCounters(Registry& registry, std::span<const Route> routes) {
    Add(registry, routes, "kdray_rays_total", "Rays answered, by query and precision.", kRaysPrefix,
        api::kPrecisionNames);
    Add(registry, routes, "kdray_points_total", "Points answered, by query and precision.",
        kPointsPrefix, api::kPointPrecisionNames);
    Add(registry, routes, "kdray_point_pairs_total",
        "Pairs of points answered, by query and precision.", kVisibility, api::kPrecisionNames);
  }

  void Count(std::string_view route, std::string_view precision, std::uint64_t rows) {
    for (const Entry& entry : entries_) {
      if (entry.precision == precision && entry.route == route) {
        entry.counter->Increment(static_cast<double>(rows));
      }
    }
  }

 private:
  struct Entry {
    std::string_view route, precision;
    Counter* counter;
  };

  void Add(Registry& registry, std::span<const Route> routes, const char* name, const char* help,
           std::string_view prefix, std::span<const std::string_view> precisions) {
    prometheus::Family<Counter>* family = nullptr;
    for (const Route& route : routes) {
      if (!route.path.starts_with(prefix)) continue;
      if (family == nullptr) {
        family = &prometheus::BuildCounter().Name(name).Help(help).Register(registry);
      }
      const std::string query(route.path.substr(route.path.rfind('/') + 1));
      for (const std::string_view precision : precisions) {
        if (precision == api::Name(api::Precision::kAuto)) continue;
        entries_.push_back(
            {route.path, precision,
             &family->Add({{"query", query}, {"precision", std::string(precision)}})});
      }
    }
  }

  std::vector<Entry> entries_;
};

}  // namespace

class Metrics::Impl {
 public:
  Impl(std::span<const Route> routes, std::size_t most_request_series)
      : requests(registry, routes, most_request_series), rows(registry, routes) {
    auto& durations = prometheus::BuildHistogram()
                          .Name("kdray_http_request_duration_seconds")
                          .Help(
                              "Time from the complete head of a request to the last byte of its "
                              "answer, by class: query, render, upload, other.")
                          .Register(registry);
    for (const auto& [request_class, name] : kClassNames) {
      seconds[static_cast<std::size_t>(request_class)] =
          &durations.Add({{"class", name}}, kSeconds);
    }
    auto& cancellations = prometheus::BuildCounter()
                              .Name("kdray_cancelled_requests_total")
                              .Help(
                                  "Requests whose work was cancelled, by reason: deadline, client "
                                  "(it left), shutdown.")
                              .Register(registry);
    past_deadline = &cancellations.Add({{"reason", "deadline"}});
    left_by_client = &cancellations.Add({{"reason", "client"}});
    shut_down = &cancellations.Add({{"reason", "shutdown"}});
    auto& picture_rays = prometheus::BuildCounter()
                             .Name("kdray_picture_rays_total")
                             .Help("Rays traced for pictures, by kind: camera, shadow, occlusion.")
                             .Register(registry);
    camera_rays = &picture_rays.Add({{"kind", "camera"}});
    shadow_rays = &picture_rays.Add({{"kind", "shadow"}});
    occlusion_rays = &picture_rays.Add({{"kind", "occlusion"}});
    auto& drops = prometheus::BuildCounter()
                      .Name("kdray_http_dropped_connections_total")
                      .Help(
                          "Connections ended for want of room, by reason: evicted (idle, or slow), "
                          "refused (new, answered with overloaded), closed (new, not answered).")
                      .Register(registry);
    for (const auto& [reason, name] : kDropNames) {
      dropped[static_cast<std::size_t>(reason)] = &drops.Add({{"reason", name}});
    }
    auto& info = prometheus::BuildGauge()
                     .Name("kdray_build_info")
                     .Help("Always 1; the label has the version of the daemon.")
                     .Register(registry);
    info.Add({{"version", KDRAY_VERSION}}).Set(1);
    auto& start = prometheus::BuildGauge()
                      .Name("process_start_time_seconds")
                      .Help("Start of the process, in seconds since 1970.")
                      .Register(registry);
    start.Add({}).SetToCurrentTime();
  }

  Registry registry;
  RequestCounters requests;
  RowCounters rows;
  std::array<Histogram*, 4> seconds{};  ///< by RequestClass
  Histogram& queue_seconds = prometheus::BuildHistogram()
                                 .Name("kdray_queue_wait_seconds")
                                 .Help("Time that requests waited for their turn to compute.")
                                 .Register(registry)
                                 .Add({}, kSeconds);
  std::array<Counter*, kDropNames.size()> dropped{};  ///< by DropReason
  Counter* past_deadline = nullptr;
  Counter* left_by_client = nullptr;
  Counter* shut_down = nullptr;
  Counter* camera_rays = nullptr;
  Counter* shadow_rays = nullptr;
  Counter* occlusion_rays = nullptr;
  Counter& received = AddCounter(registry, "kdray_http_received_body_bytes_total",
                                 "Bytes of requests' bodies, as sent, without chunk framing.");
  Counter& sent =
      AddCounter(registry, "kdray_http_sent_bytes_total", "Bytes of answers, with their heads.");
  Counter& gone = AddCounter(registry, "kdray_http_clients_gone_total",
                             "Requests whose client left before the answer.");
  Counter& accepted = AddCounter(registry, "kdray_http_accepted_connections_total",
                                 "Connections accepted, refused ones included.");
  Counter& accept_failures =
      AddCounter(registry, "kdray_http_accept_failures_total",
                 "Attempts to accept a connection that failed for want of descriptors or memory.");
  Gauge& connections = prometheus::BuildGauge()
                           .Name("kdray_http_connections")
                           .Help("Open connections.")
                           .Register(registry)
                           .Add({});
};

Metrics::Metrics(std::span<const Route> routes, bool has_shared_store)
    : impl_(std::make_unique<Impl>(
          routes, has_shared_store ? kMaxRequestSeries - kSharedStoreSeries : kMaxRequestSeries)) {}
Metrics::~Metrics() = default;

void Metrics::Answered(const HttpRecord& record) noexcept {
  try {
    impl_->requests.Count(record.route, record.status);
  } catch (...) {
    // No memory for a new line: this request is not counted.
  }
  impl_->seconds[static_cast<std::size_t>(ClassOf(record))]->Observe(record.ms / 1000);
  impl_->received.Increment(static_cast<double>(record.bytes_in));
  impl_->sent.Increment(static_cast<double>(record.bytes_out));
  if (record.status == kClientGone) {
    impl_->gone.Increment();
    impl_->left_by_client->Increment();
  } else if (record.error_code == api::Name(api::ErrorCode::kDeadlineExceeded)) {
    impl_->past_deadline->Increment();
  } else if (record.error_code == api::Name(api::ErrorCode::kDraining) && !record.route.empty()) {
    impl_->shut_down->Increment();
  }
}

void Metrics::ConnectionOpened() noexcept {
  impl_->accepted.Increment();
  impl_->connections.Increment();
}

void Metrics::ConnectionClosed() noexcept { impl_->connections.Decrement(); }

void Metrics::ConnectionDropped(DropReason reason) noexcept {
  impl_->dropped[static_cast<std::size_t>(reason)]->Increment();
}

void Metrics::AcceptFailed() noexcept { impl_->accept_failures.Increment(); }

void Metrics::GotTurn(double waited_ms) noexcept { impl_->queue_seconds.Observe(waited_ms / 1000); }

void Metrics::CountRows(std::string_view route, std::string_view precision,
                        std::uint64_t rows) noexcept {
  impl_->rows.Count(route, precision, rows);
}

void Metrics::CountPicture(const api::RenderCounts& counts) noexcept {
  impl_->camera_rays->Increment(static_cast<double>(counts.camera_rays));
  impl_->shadow_rays->Increment(static_cast<double>(counts.shadow_rays));
  impl_->occlusion_rays->Increment(static_cast<double>(counts.occlusion_rays));
}

std::string Metrics::Text(const CurrentValues& now) const {
  std::vector<prometheus::MetricFamily> families = impl_->registry.Collect();
  AppendCurrent(now, families);
  std::ostringstream out;
  prometheus::TextSerializer().Serialize(out, families);
  return std::move(out).str();
}

}  // namespace kdray::server
