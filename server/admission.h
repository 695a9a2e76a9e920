// The limit on simultaneous work. Beyond it, requests fail at once with `overloaded`, so accepted
// requests stay quick.
#pragma once

#include <condition_variable>
#include <cstddef>
#include <list>
#include <memory>
#include <mutex>
#include <utility>

#include "api/types.h"
#include "core/base/cancel.h"

namespace kdray::server {

/// Turns for work that computes: queries, renders, cells. First come, first served: a turn that
/// ends passes to the first waiter, and no other thread wakes. Safe from many threads at once.
class Admission {
 public:
  /// At most `max_running` turns at the same time; at most `max_queued` requests wait for one.
  Admission(std::size_t max_running, std::size_t max_queued)
      : max_running_(max_running), max_queued_(max_queued) {}

  /// The right to compute, during its lifetime.
  class Turn {
   public:
    Turn(Turn&& other) noexcept
        : admission_(std::exchange(other.admission_, nullptr)), waited_ms_(other.waited_ms_) {}
    Turn& operator=(Turn&&) = delete;
    ~Turn() {
      if (admission_ != nullptr) admission_->Leave();
    }
    /// The time waited for it.
    double waited_ms() const { return waited_ms_; }

   private:
    friend class Admission;
    Turn(Admission* admission, double waited_ms) : admission_(admission), waited_ms_(waited_ms) {}
    Admission* admission_;
    double waited_ms_;
  };

  /// Waits for a turn. overloaded at once if the queue is full; deadline_exceeded if the deadline
  /// of `cancel` comes first; draining if it is cancelled, which a client that has left does not
  /// read.
  api::Outcome<Turn> Enter(const core::CancelToken& cancel);

  std::size_t running() const;
  std::size_t queued() const;

 private:
  struct Waiter {
    std::condition_variable called;
    bool has_turn = false;  ///< guarded by mutex_
  };

  void Leave();

  const std::size_t max_running_, max_queued_;
  mutable std::mutex mutex_;
  std::size_t running_ = 0;  ///< turns, those of waiters that were called included
  std::list<std::shared_ptr<Waiter>> waiters_;  ///< without a turn, the first in line first
};

}  // namespace kdray::server
