// SPDX-License-Identifier: Apache-2.0
#include "core/library/memory_budget.h"

#include <algorithm>
#include <chrono>
#include <string>

namespace kdray::core {
namespace {

// Poll interval of waiters: CancelToken has no notification, nor has a query whose end makes a
// cached tree evictable.
constexpr std::chrono::milliseconds kLookAgain{20};

}  // namespace

MemoryCharge::~MemoryCharge() { Shrink(0); }

bool MemoryCharge::Grow(std::uint64_t bytes) {
  if (bytes <= bytes_) return true;
  if (!budget_->TryTake(bytes - bytes_, true)) return false;
  bytes_ = bytes;
  return true;
}

void MemoryCharge::Shrink(std::uint64_t bytes) {
  if (bytes >= bytes_) return;
  budget_->Release(bytes_ - bytes);
  bytes_ = bytes;
}

MemoryCharge MemoryCharge::Split(std::uint64_t bytes) {
  const std::uint64_t taken = std::min(bytes, bytes_);
  bytes_ -= taken;
  return MemoryCharge(budget_, taken);
}

void MemoryCharge::Add(MemoryCharge other) {
  if (budget_ == nullptr) budget_ = other.budget_;
  bytes_ += std::exchange(other.bytes_, 0);
}

Status MemoryBudget::CheckCouldFit(std::uint64_t bytes) const {
  if (bytes <= limit_) return {};
  return Error{ErrorCode::kMeshTooLarge, "this needs about " + std::to_string(bytes) +
                                             " bytes of memory; the limit is " +
                                             std::to_string(limit_)};
}

Result<MemoryCharge> MemoryBudget::Reserve(std::uint64_t bytes, const CancelToken& cancel,
                                           std::atomic<bool>* waiting) {
  if (Status status = CheckCouldFit(bytes); !status.ok()) return std::move(status).error();
  if (TryTake(bytes, false)) return MemoryCharge(this, bytes);
  // Made before anything changes, so a failed allocation has no effect.
  Error no_memory{ErrorCode::kMemoryFull, "other work held the memory that this needs, about " +
                                              std::to_string(bytes) + " of " +
                                              std::to_string(limit_) + " bytes"};
  std::unique_lock lock(mutex_);
  const std::optional<WaitingLine::Place> place = line_.Enter(now_());
  if (!place) return no_memory;
  if (waiting != nullptr) *waiting = true;
  // Leaves the line even if an exception is thrown.
  struct Leaver {
    MemoryBudget* budget;
    std::unique_lock<std::mutex>* lock;
    WaitingLine::Place place;
    std::atomic<bool>* waiting;
    ~Leaver() {
      if (!lock->owns_lock()) lock->lock();
      budget->line_.Leave(place);
      if (waiting != nullptr) *waiting = false;
      budget->changed_.notify_all();
    }
  } const leaver{this, &lock, *place, waiting};
  while (!TakeInTurn(bytes, *place, &lock)) {
    if (cancel.ShouldStop()) return cancel.ToError();
    if (line_.MustGiveUp(*place, now_())) return no_memory;
    changed_.wait_for(lock, kLookAgain);
  }
  return MemoryCharge(this, bytes);
}

// For a waiter; false if it must continue to wait.
bool MemoryBudget::TakeInTurn(std::uint64_t bytes, WaitingLine::Place place,
                              std::unique_lock<std::mutex>* lock) {
  while (line_.MayTake(place, now_())) {
    if (used_ + bytes <= limit_) {
      used_ += bytes;
      return true;
    }
    const std::uint64_t missing = used_ + bytes - limit_;
    lock->unlock();
    const std::uint64_t freed = reclaim_ ? reclaim_(missing) : 0;
    lock->lock();
    if (freed == 0) return false;
  }
  return false;
}

std::optional<MemoryCharge> MemoryBudget::TryReserve(std::uint64_t bytes) {
  if (!TryTake(bytes, false)) return std::nullopt;
  return MemoryCharge(this, bytes);
}

bool MemoryBudget::TryTake(std::uint64_t bytes, bool passes_all) {
  if (bytes > limit_) return false;
  std::unique_lock lock(mutex_);
  for (;;) {
    if (!passes_all && !line_.MayPass(now_())) return false;
    if (used_ + bytes <= limit_) {
      used_ += bytes;
      return true;
    }
    const std::uint64_t missing = used_ + bytes - limit_;
    lock.unlock();
    if (!reclaim_ || reclaim_(missing) == 0) return false;
    lock.lock();
  }
}

void MemoryBudget::Release(std::uint64_t bytes) {
  const std::lock_guard lock(mutex_);
  used_ -= bytes;
  changed_.notify_all();
}

std::uint64_t MemoryBudget::used() const {
  const std::lock_guard lock(mutex_);
  return used_;
}

}  // namespace kdray::core
