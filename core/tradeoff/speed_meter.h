// SPDX-License-Identifier: Apache-2.0
// Measures the rays a second of one build in one precision.
#pragma once

#include <chrono>
#include <cstddef>
#include <span>
#include <vector>

#include "core/base/cancel.h"
#include "core/base/result.h"
#include "core/geometry/hit.h"
#include "core/geometry/ray.h"
#include "core/scene/scene.h"
#include "core/tradeoff/tradeoff.h"

namespace kdray::core {

/// Times runs over one set of rays. A run begins with one ray a thread and takes more while they
/// are quick, so it ends in time even if a ray takes milliseconds. The scene and the rays must
/// outlive it. For one thread at a time, within the arena that does the work.
class SpeedMeter {
 public:
  SpeedMeter(const Scene& scene, std::span<const Ray> rays, Precision precision, int threads);

  /// Makes one run of about the given time. Errors: kCancelled, kDeadlineExceeded.
  Status Run(std::chrono::nanoseconds time, const CancelToken& cancel);

  /// The result of all runs so far.
  Speed Sum() const;
  /// Hits of the rays that were traced, from the first on.
  std::span<const Hit> hits() const { return std::span(hits_).first(traced_); }

 private:
  Status TraceRound(std::size_t first, std::size_t last, const CancelToken& cancel);

  const Scene& scene_;
  std::span<const Ray> rays_;
  Precision precision_;
  std::size_t threads_;
  std::size_t round_;     // rays of a round
  std::size_t next_ = 0;  // first ray of the next round
  std::size_t traced_ = 0;
  std::vector<Hit> hits_;
  std::vector<double> rates_;  // of the runs
};

}  // namespace kdray::core
