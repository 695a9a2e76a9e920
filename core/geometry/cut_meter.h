// Counts what the cutting of polygons costs, for a bound per file and for cancellation.
#pragma once

#include <algorithm>
#include <cstdint>
#include <utility>

#include "core/base/cancel.h"

namespace kdray::core {

/// Counts steps of about a nanosecond. The same input takes the same steps on every machine, so a
/// file that is refused for its cost is refused everywhere. Not safe from two threads at once.
class CutMeter {
 public:
  /// No step is allowed yet.
  explicit CutMeter(CancelToken token) : token_(std::move(token)) {}

  void Allow(std::uint64_t steps) { allowed_ += steps; }

  /// Counts steps. True when it is time to give up: the token asks for it, or more steps were
  /// spent than allowed. Once true, always true. Looks at the token every 131,072 steps.
  bool Spend(std::uint64_t steps) {
    spent_ += steps;
    return spent_ >= next_look_ && Look();
  }
  bool stopped() const { return stopped_; }
  bool exhausted() const { return spent_ > allowed_; }
  std::uint64_t allowed() const { return allowed_; }
  std::uint64_t spent() const { return spent_; }

 private:
  bool Look() {
    stopped_ = stopped_ || exhausted() || token_.ShouldStop();
    next_look_ = stopped_ ? 0 : std::min(spent_ + 131072, allowed_ + 1);
    return stopped_;
  }

  CancelToken token_;
  std::uint64_t allowed_ = 0;
  std::uint64_t spent_ = 0;
  std::uint64_t next_look_ = 0;
  bool stopped_ = false;
};

}  // namespace kdray::core
