// SPDX-License-Identifier: Apache-2.0
// One limit for all memory that grows with meshes. Work reserves memory before it allocates, so too
// much work waits or fails instead of meeting the kernel's OOM killer.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <mutex>
#include <optional>
#include <utility>

#include "core/base/cancel.h"
#include "core/base/result.h"
#include "core/library/waiting_line.h"

namespace kdray::core {

class MemoryBudget;

/// Reserved bytes, returned when destroyed. Moved together with the memory that it covers. For one
/// thread at a time.
class MemoryCharge {
 public:
  MemoryCharge() = default;
  MemoryCharge(MemoryCharge&& other) noexcept
      : budget_(std::exchange(other.budget_, nullptr)), bytes_(std::exchange(other.bytes_, 0)) {}
  MemoryCharge& operator=(MemoryCharge&& other) noexcept {
    std::swap(budget_, other.budget_);
    std::swap(bytes_, other.bytes_);
    return *this;
  }
  ~MemoryCharge();

  std::uint64_t bytes() const { return bytes_; }
  /// Raises the charge to at least `bytes`; false if that does not fit now. It passes those that
  /// wait, because work that already holds memory returns it sooner if it ends sooner.
  [[nodiscard]] bool Grow(std::uint64_t bytes);
  /// Lowers the charge to at most `bytes`.
  void Shrink(std::uint64_t bytes);
  /// Moves min(bytes, bytes()) from this charge to the result.
  MemoryCharge Split(std::uint64_t bytes);
  /// Moves the bytes of `other`, of the same budget, to this charge, which may be empty.
  void Add(MemoryCharge other);

 private:
  friend class MemoryBudget;
  MemoryCharge(MemoryBudget* budget, std::uint64_t bytes) : budget_(budget), bytes_(bytes) {}

  MemoryBudget* budget_ = nullptr;
  std::uint64_t bytes_ = 0;
};

/// Safe from many threads at once. Must outlive its charges.
class MemoryBudget {
 public:
  using Clock = WaitingLine::Clock;
  /// Evicts unused items until `bytes` are free; returns the number of freed bytes. Called without
  /// a lock, from any thread.
  using Reclaim = std::function<std::uint64_t(std::uint64_t bytes)>;
  /// The time, for the rule of waiting.
  using Now = std::function<Clock::time_point()>;

  explicit MemoryBudget(std::uint64_t limit_bytes, const WaitingLine::Rule& rule = {},
                        Now now = Clock::now)
      : limit_(limit_bytes), now_(std::move(now)), line_(rule) {}
  /// Call before the budget is used.
  void set_reclaim(Reclaim reclaim) { reclaim_ = std::move(reclaim); }

  /// kMeshTooLarge if `bytes` exceed the limit.
  Status CheckCouldFit(std::uint64_t bytes) const;
  /// Waits until the bytes are free, by the rule of WaitingLine. The caller must hold nothing that
  /// others wait for. `waiting`, if given, is true during the wait. Errors: kMeshTooLarge as above;
  /// kMemoryFull after the longest allowed wait, or if too many wait already; kCancelled,
  /// kDeadlineExceeded.
  Result<MemoryCharge> Reserve(std::uint64_t bytes, const CancelToken& cancel,
                               std::atomic<bool>* waiting = nullptr);
  /// nullopt if they are not free now, or a waiter has its turn.
  std::optional<MemoryCharge> TryReserve(std::uint64_t bytes);

  std::uint64_t limit() const { return limit_; }
  std::uint64_t used() const;

 private:
  friend class MemoryCharge;
  bool TryTake(std::uint64_t bytes, bool passes_all);
  bool TakeInTurn(std::uint64_t bytes, WaitingLine::Place place,
                  std::unique_lock<std::mutex>* lock);
  void Release(std::uint64_t bytes);

  const std::uint64_t limit_;
  const Now now_;
  Reclaim reclaim_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::uint64_t used_ = 0;
  WaitingLine line_;
};

}  // namespace kdray::core
