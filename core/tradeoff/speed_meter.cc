// SPDX-License-Identifier: Apache-2.0
#include "core/tradeoff/speed_meter.h"

#include <algorithm>
#include <mutex>
#include <utility>

#include "core/base/parallel.h"
#include "core/trace/trace.h"

namespace kdray::core {
namespace {

using SteadyClock = std::chrono::steady_clock;

// From this size on, TraceClosest distributes the rays over the threads by itself.
constexpr std::size_t kWholeBatch = 4 * 4096;

}  // namespace

SpeedMeter::SpeedMeter(const Scene& scene, std::span<const Ray> rays, Precision precision,
                       int threads)
    : scene_(scene),
      rays_(rays),
      precision_(precision),
      threads_(static_cast<std::size_t>(threads)),
      round_(std::min(rays.size(), threads_)),
      hits_(rays.size()) {}

Status SpeedMeter::Run(std::chrono::nanoseconds time, const CancelToken& cancel) {
  using Seconds = std::chrono::duration<double>;
  if (rays_.empty()) return {};
  const auto begin = SteadyClock::now();
  // Counts only the rounds of the latest size: the first ones, with few rays, only determine that
  // size.
  std::size_t rays = 0;
  auto rays_begin = begin;
  for (;;) {
    const auto round_begin = SteadyClock::now();
    const std::size_t last = std::min(rays_.size(), next_ + round_);
    if (Status status = TraceRound(next_, last, cancel); !status.ok()) return status;
    const auto now = SteadyClock::now();
    rays += last - next_;
    traced_ = std::max(traced_, last);
    next_ = last == rays_.size() ? 0 : last;
    if (now - begin >= time) {
      rates_.push_back(static_cast<double>(rays) /
                       std::max(Seconds(now - rays_begin).count(), 1e-9));
      return {};
    }
    if (round_ < rays_.size() && now - round_begin < time / 16) {
      round_ = std::min(rays_.size(), 4 * round_);
      rays = 0;
      rays_begin = now;
    }
  }
}

Status SpeedMeter::TraceRound(std::size_t first, std::size_t last, const CancelToken& cancel) {
  const std::size_t count = last - first;
  const std::size_t piece =
      count >= kWholeBatch ? count : std::max<std::size_t>(1, (count - 1) / threads_ + 1);
  std::mutex mutex;
  Status status;
  ParallelFor(first, last, piece, [&](std::size_t begin, std::size_t end) {
    Status traced = TraceClosest(scene_, rays_.subspan(begin, end - begin), {precision_, cancel},
                                 std::span(hits_).subspan(begin, end - begin));
    if (traced.ok()) return;
    const std::lock_guard lock(mutex);
    status = std::move(traced);
  });
  return status;
}

Speed SpeedMeter::Sum() const {
  if (rates_.empty()) return {};
  std::vector<double> rates = rates_;
  std::sort(rates.begin(), rates.end());
  const std::size_t middle = rates.size() / 2;
  const double median =
      rates.size() % 2 == 1 ? rates[middle] : 0.5 * (rates[middle - 1] + rates[middle]);
  return {median, rates.front(), rates.back()};
}

}  // namespace kdray::core
