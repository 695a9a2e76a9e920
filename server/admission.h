// How much work is taken on at a time. Beyond it a client is told at once to come back, which keeps
// those that were let in quick.
#pragma once

#include <condition_variable>
#include <cstddef>
#include <list>
#include <mutex>
#include <utility>

#include "api/types.h"
#include "core/base/cancel.h"

namespace kdray::server {

/// Turns for work that computes: queries, renders, cells. First come, first served. Safe from many
/// threads at once.
class Admission {
 public:
  /// `max_running` turns at the same time; beyond them `max_queued` wait for one.
  Admission(std::size_t max_running, std::size_t max_queued)
      : max_running_(max_running), max_queued_(max_queued) {}

  /// The right to compute, for as long as it lives.
  class Turn {
   public:
    Turn(Turn&& other) noexcept
        : admission_(std::exchange(other.admission_, nullptr)), waited_ms_(other.waited_ms_) {}
    Turn& operator=(Turn&&) = delete;
    ~Turn() {
      if (admission_ != nullptr) admission_->Leave();
    }
    /// How long it was waited for.
    double waited_ms() const { return waited_ms_; }

   private:
    friend class Admission;
    Turn(Admission* admission, double waited_ms) : admission_(admission), waited_ms_(waited_ms) {}
    Admission* admission_;
    double waited_ms_;
  };

  /// Waits for a turn. overloaded at once when the queue is full; deadline_exceeded when the
  /// deadline of `cancel` comes first; draining when it is cancelled, which a client that has left
  /// does not read.
  api::Outcome<Turn> Enter(const core::CancelToken& cancel);

  std::size_t running() const;
  std::size_t queued() const;

 private:
  void Leave();

  const std::size_t max_running_, max_queued_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::size_t running_ = 0;
  std::list<char> queue_;  ///< one element a waiter, the first in line first
};

}  // namespace kdray::server
