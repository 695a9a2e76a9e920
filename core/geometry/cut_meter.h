// SPDX-License-Identifier: Apache-2.0
// Counts the cost of triangulating polygons, for a limit per file and for cancellation.
#pragma once

#include <cstdint>
#include <utility>

#include "core/base/cancel.h"
#include "core/base/cancel_poll.h"

namespace kdray::core {

/// Counts steps of about a nanosecond. The same input takes the same number of steps on every
/// machine, so a file that exceeds the limit does so everywhere. Not safe from two threads at once.
class CutMeter {
 public:
  /// No step is allowed yet.
  explicit CutMeter(CancelToken token) : poll_(std::move(token)) {}

  void Allow(std::uint64_t steps) { allowed_ += steps; }

  /// Counts steps. Returns true when the work must stop: the token has stopped, or more steps were
  /// spent than allowed. Once true, it stays true unless Allow() adds steps.
  bool Spend(std::uint64_t steps) {
    spent_ += steps;
    return poll_.Spend(steps) || exhausted();
  }
  bool stopped() const { return poll_.stopped() || exhausted(); }
  bool exhausted() const { return spent_ > allowed_; }
  std::uint64_t allowed() const { return allowed_; }
  std::uint64_t spent() const { return spent_; }
  /// The token's error.
  Error ToError() const { return poll_.ToError(); }

 private:
  CancelPoll poll_;
  std::uint64_t allowed_ = 0;
  std::uint64_t spent_ = 0;
};

}  // namespace kdray::core
