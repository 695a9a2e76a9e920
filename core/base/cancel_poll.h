// SPDX-License-Identifier: Apache-2.0
// Checks a cancel token at intervals of work done, so every loop whose length depends on the input
// ends soon after its cancellation.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <utility>

#include "core/base/cancel.h"

namespace kdray::core {

/// Counts one thread's work. The unit of work is about a nanosecond. A caller rounds the cost of
/// its step up, within a factor of 10. The token, which reads the clock, is checked at the first
/// step and then once in kWorkPerLook. So a step that costs 100 times what it declares still leaves
/// some 13 ms between two checks.
class CancelPoll {
 public:
  static constexpr std::uint64_t kWorkPerLook = std::uint64_t{1} << 17;

  explicit CancelPoll(CancelToken token) : token_(std::move(token)) {}

  /// Counts a step of `work` units. Returns whether to stop; once true, always true, so the result
  /// of a nested step may be ignored. The usual case is a subtraction.
  bool Spend(std::uint64_t work) {
    if (work < left_) [[likely]] {
      left_ -= work;
      return false;
    }
    return Look();
  }
  /// Whether a call of Spend() has returned true.
  bool stopped() const { return stopped_; }

  Error ToError() const { return token_.ToError(); }
  /// Success, or the reason why Spend() returned true.
  Status ToStatus() const { return stopped_ ? Status(ToError()) : Status(); }

 private:
  [[gnu::cold, gnu::noinline]] bool Look() {
    // After a stop `left_` stays 0, so every step comes here.
    stopped_ = stopped_ || token_.ShouldStop();
    left_ = stopped_ ? 0 : kWorkPerLook;
    return stopped_;
  }

  CancelToken token_;
  std::uint64_t left_ = 0;
  bool stopped_ = false;
};

/// f(i) for each i in [0, count), each counted as `work`, which must be small: the poll is charged
/// once in 1024. False when it has stopped; then f was not called for some i.
template <class F>
bool PolledLoop(std::size_t count, std::uint64_t work, CancelPoll* poll, const F& f) {
  constexpr std::size_t kPiece = 1024;
  for (std::size_t first = 0; first < count; first += kPiece) {
    const std::size_t last = std::min(count, first + kPiece);
    if (poll->Spend((last - first) * work)) return false;
    for (std::size_t i = first; i < last; ++i) f(i);
  }
  return true;
}

}  // namespace kdray::core
