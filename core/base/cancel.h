// SPDX-License-Identifier: Apache-2.0
// Cancellation: by a deadline or by request. Loops check the token through a CancelPoll
// (core/base/cancel_poll.h), which counts the work done. Functions that are cancelled return
// kCancelled or kDeadlineExceeded and leave nothing half done.
#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <memory>
#include <optional>
#include <utility>

#include "core/base/result.h"

namespace kdray::core {

/// Copies share one state, so a watcher may call Cancel() while workers call ShouldStop(). A
/// stopped token stays stopped. A default-constructed token never stops. Safe from many threads at
/// once.
class CancelToken {
 public:
  using Clock = std::chrono::steady_clock;

  CancelToken() = default;
  static CancelToken WithDeadline(Clock::time_point deadline) {
    CancelToken token;
    token.state_ = std::make_shared<State>();
    token.state_->deadline = deadline;
    return token;
  }
  static CancelToken Cancellable() { return WithDeadline(Clock::time_point::max()); }
  /// Cancelled as soon as `condition` returns true. Every check calls it, on the checking thread.
  static CancelToken When(std::function<bool()> condition) {
    CancelToken token = Cancellable();
    token.state_->condition = std::move(condition);
    return token;
  }

  /// Stops all copies. No effect on a default-constructed token.
  void Cancel() const {
    if (state_) state_->cancelled.store(true, std::memory_order_relaxed);
  }

  /// kCancelled or kDeadlineExceeded when the token has stopped, else nullopt. Reads the clock:
  /// some 30 ns.
  std::optional<ErrorCode> Reason() const {
    if (!state_) return std::nullopt;
    if (state_->condition && state_->condition()) Cancel();
    if (state_->cancelled.load(std::memory_order_relaxed)) return ErrorCode::kCancelled;
    if (state_->deadline != Clock::time_point::max() && Clock::now() >= state_->deadline) {
      return ErrorCode::kDeadlineExceeded;
    }
    return std::nullopt;
  }
  bool ShouldStop() const { return Reason().has_value(); }

  /// The Error to return after ShouldStop() returned true.
  Error ToError() const {
    const ErrorCode code = Reason().value_or(ErrorCode::kCancelled);
    return Error{code, code == ErrorCode::kCancelled ? "cancelled" : "the deadline has passed"};
  }

  Clock::time_point deadline() const {
    return state_ ? state_->deadline : Clock::time_point::max();
  }

 private:
  struct State {
    std::atomic<bool> cancelled{false};
    Clock::time_point deadline = Clock::time_point::max();
    std::function<bool()> condition;
  };
  std::shared_ptr<State> state_;
};

}  // namespace kdray::core
