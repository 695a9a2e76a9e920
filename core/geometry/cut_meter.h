// Counts what the cutting of polygons costs, for a bound per file and for cancellation.
#pragma once

#include <cstdint>
#include <utility>

#include "core/base/cancel.h"
#include "core/base/cancel_poll.h"

namespace kdray::core {

/// Counts steps of about a nanosecond. The same input takes the same steps on every machine, so a
/// file that is refused for its cost is refused everywhere. Not safe from two threads at once.
class CutMeter {
 public:
  /// No step is allowed yet.
  explicit CutMeter(CancelToken token) : poll_(std::move(token)) {}

  void Allow(std::uint64_t steps) { allowed_ += steps; }

  /// Counts steps. True when it is time to give up: the token asks for it, or more steps were
  /// spent than allowed. Once true, true for ever unless more is allowed.
  bool Spend(std::uint64_t steps) {
    spent_ += steps;
    return poll_.Spend(steps) || exhausted();
  }
  bool stopped() const { return poll_.stopped() || exhausted(); }
  bool exhausted() const { return spent_ > allowed_; }
  std::uint64_t allowed() const { return allowed_; }
  std::uint64_t spent() const { return spent_; }
  /// The token's.
  Error ToError() const { return poll_.ToError(); }

 private:
  CancelPoll poll_;
  std::uint64_t allowed_ = 0;
  std::uint64_t spent_ = 0;
};

}  // namespace kdray::core
