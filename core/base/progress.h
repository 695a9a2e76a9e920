// SPDX-License-Identifier: Apache-2.0
// The progress of a long piece of work, for people who wait for it.
#pragma once

#include <atomic>

namespace kdray::core {

/// A fraction 0..1 that only grows. Safe from many threads at once.
class Progress {
 public:
  /// Adds to the fraction done; the sum is clamped to 1.
  void Add(double fraction) {
    double seen = done_.load(std::memory_order_relaxed);
    while (!done_.compare_exchange_weak(seen, seen + fraction, std::memory_order_relaxed)) {
    }
  }
  void Finish() { done_.store(1.0, std::memory_order_relaxed); }
  double fraction() const {
    const double done = done_.load(std::memory_order_relaxed);
    return done < 0 ? 0.0 : done > 1 ? 1.0 : done;
  }

 private:
  std::atomic<double> done_{0.0};
};

}  // namespace kdray::core
