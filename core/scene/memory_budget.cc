#include "core/scene/memory_budget.h"

#include <algorithm>
#include <chrono>
#include <string>

namespace kdray::core {
namespace {

// A waiter looks again this often: a token that is cancelled notifies nobody, and neither does a
// query that ends and so makes a cached tree evictable.
constexpr std::chrono::milliseconds kLookAgain{20};

}  // namespace

MemoryCharge::~MemoryCharge() { Shrink(0); }

bool MemoryCharge::Grow(std::uint64_t bytes) {
  if (bytes <= bytes_) return true;
  if (!budget_->TryTake(bytes - bytes_)) return false;
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

Result<MemoryCharge> MemoryBudget::Reserve(std::uint64_t bytes, const CancelToken& cancel,
                                           std::atomic<bool>* waiting) {
  if (bytes > limit_) {
    return Error{ErrorCode::kMeshTooLarge, "this needs about " + std::to_string(bytes) +
                                               " bytes of memory; the limit is " +
                                               std::to_string(limit_)};
  }
  std::unique_lock lock(mutex_);
  const std::uint64_t ticket = next_ticket_++;
  waiting_.push_back(ticket);
  std::optional<Error> stopped;
  for (;;) {
    if (waiting_.front() == ticket) {
      if (used_ + bytes <= limit_) break;
      const std::uint64_t missing = used_ + bytes - limit_;
      lock.unlock();
      const std::uint64_t freed = reclaim_ ? reclaim_(missing) : 0;
      lock.lock();
      if (freed != 0) continue;
    }
    if (cancel.ShouldStop()) {
      stopped = cancel.ToError();
      break;
    }
    if (waiting != nullptr) *waiting = true;
    changed_.wait_for(lock, kLookAgain);
  }
  if (waiting != nullptr) *waiting = false;
  waiting_.erase(std::find(waiting_.begin(), waiting_.end(), ticket));
  changed_.notify_all();
  if (stopped) return *std::move(stopped);
  used_ += bytes;
  return MemoryCharge(this, bytes);
}

std::optional<MemoryCharge> MemoryBudget::TryReserve(std::uint64_t bytes) {
  if (!TryTake(bytes)) return std::nullopt;
  return MemoryCharge(this, bytes);
}

bool MemoryBudget::TryTake(std::uint64_t bytes) {
  if (bytes > limit_) return false;
  std::unique_lock lock(mutex_);
  for (;;) {
    if (!waiting_.empty()) return false;
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
