// SPDX-License-Identifier: Apache-2.0
// The limit on simultaneous work, for each size of work. Beyond it, requests fail at once with
// `overloaded`, so accepted requests stay quick.
#pragma once

#include <array>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <list>
#include <memory>
#include <mutex>
#include <utility>

#include "api/types.h"
#include "core/base/cancel.h"

namespace kdray::server {

/// Work of about one size. Each lane has turns and a queue of its own, so work waits for work of
/// its own size only (DESIGN.md, decision 41).
enum class Lane : std::uint8_t {
  kShort,   ///< milliseconds
  kMedium,  ///< up to about a second
  kLong,
};
inline constexpr std::size_t kLaneCount = 3;

/// The lane of work that traces about `rays` rays, or takes as long.
Lane LaneOf(std::uint64_t rays);

/// Turns for work that computes: queries, renders, cells. First come, first served within a lane: a
/// turn that ends passes to the lane's first waiter, and no other thread wakes. Safe from many
/// threads at once.
class Admission {
 public:
  /// In each lane, at most `max_running` turns at the same time, and at most `max_queued` requests
  /// that wait for one.
  /// Short work has `short_factor` times as many turns: handing a turn over takes as long as such
  /// work, and a thread that waits for a processor keeps its turn meanwhile.
  Admission(std::size_t max_running, std::size_t max_queued, std::size_t short_factor = 1)
      : max_queued_(max_queued) {
    for (Line& line : lines_) line.turns = max_running;
    LineOf(Lane::kShort).turns *= short_factor;
  }

  /// The right to compute, during its lifetime.
  class Turn {
   public:
    Turn(Turn&& other) noexcept
        : admission_(std::exchange(other.admission_, nullptr)),
          lane_(other.lane_),
          waited_ms_(other.waited_ms_) {}
    Turn& operator=(Turn&&) = delete;
    ~Turn() {
      if (admission_ != nullptr) admission_->Leave(lane_);
    }
    /// The time waited for it.
    double waited_ms() const { return waited_ms_; }

   private:
    friend class Admission;
    Turn(Admission* admission, Lane lane, double waited_ms)
        : admission_(admission), lane_(lane), waited_ms_(waited_ms) {}
    Admission* admission_;
    Lane lane_;
    double waited_ms_;
  };

  /// Waits for a turn. overloaded at once if the lane's queue is full; deadline_exceeded if the
  /// deadline of `cancel` comes first; draining if it is cancelled, which a client that has left
  /// does not read.
  api::Outcome<Turn> Enter(Lane lane, const core::CancelToken& cancel);
  /// The problem with which Enter() would fail at once. Takes nothing.
  api::Check Check(Lane lane) const;

  // Of all lanes.
  std::size_t running() const;
  std::size_t queued() const;

 private:
  struct Waiter {
    std::condition_variable called;
    bool has_turn = false;  ///< guarded by mutex_
  };

  struct Line {
    std::size_t turns = 0;
    std::size_t running = 0;  ///< turns, those of waiters that were called included
    std::list<std::shared_ptr<Waiter>> waiters;  ///< without a turn, the first in line first
  };

  void Leave(Lane lane);
  Line& LineOf(Lane lane) { return lines_[static_cast<std::size_t>(lane)]; }
  api::Check CheckLocked(const Line& line) const;

  const std::size_t max_queued_;
  mutable std::mutex mutex_;
  std::array<Line, kLaneCount> lines_;
};

}  // namespace kdray::server
