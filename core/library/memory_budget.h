// One limit for all memory that grows with meshes: whoever is about to hold some reserves it
// first, so that too much work is refused or waits instead of meeting the system's last resort.
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

/// Bytes that are reserved; given back when destroyed. Moved along with what it pays for. One
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
  /// At least `bytes` from now on; false when that does not fit at once. It passes those who wait:
  /// what holds memory already gives it back the sooner the sooner it is done.
  [[nodiscard]] bool Grow(std::uint64_t bytes);
  /// At most `bytes` from now on.
  void Shrink(std::uint64_t bytes);
  /// Takes min(bytes, bytes()) out of this charge.
  MemoryCharge Split(std::uint64_t bytes);

 private:
  friend class MemoryBudget;
  MemoryCharge(MemoryBudget* budget, std::uint64_t bytes) : budget_(budget), bytes_(bytes) {}

  MemoryBudget* budget_ = nullptr;
  std::uint64_t bytes_ = 0;
};

/// Safe from many threads at once. Outlives its charges.
class MemoryBudget {
 public:
  using Clock = WaitingLine::Clock;
  /// Asked to let go of some `bytes` that nobody uses; returns how many it let go. Called without
  /// a lock, from any thread.
  using Reclaim = std::function<std::uint64_t(std::uint64_t bytes)>;
  /// The time, for the rule of waiting.
  using Now = std::function<Clock::time_point()>;

  explicit MemoryBudget(std::uint64_t limit_bytes, const WaitingLine::Rule& rule = {},
                        Now now = Clock::now)
      : limit_(limit_bytes), now_(std::move(now)), line_(rule) {}
  /// Before the budget is used.
  void set_reclaim(Reclaim reclaim) { reclaim_ = std::move(reclaim); }

  /// kMeshTooLarge when `bytes` are more than the limit.
  Status CheckCouldFit(std::uint64_t bytes) const;
  /// Waits until the bytes are free, by the rule of WaitingLine. Hold nothing meanwhile that others
  /// wait for. `waiting`, if given, is true while it waits. Errors: kMeshTooLarge as above;
  /// kMemoryFull when it waited as long as anybody may, or too many wait already; kCancelled,
  /// kDeadlineExceeded.
  Result<MemoryCharge> Reserve(std::uint64_t bytes, const CancelToken& cancel,
                               std::atomic<bool>* waiting = nullptr);
  /// Nothing when they are not free at once, or one who waits has its turn.
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
