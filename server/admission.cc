#include "server/admission.h"

#include <algorithm>
#include <chrono>
#include <string>

namespace kdray::server {
namespace {

using api::ErrorCode;
using api::Problem;
using Clock = std::chrono::steady_clock;

/// Poll interval of waiters: a client's departure sets a flag without notification.
constexpr std::chrono::milliseconds kLook{50};

Problem StoppedWaiting(const core::CancelToken& cancel) {
  if (cancel.Reason() == core::ErrorCode::kCancelled) {
    return {.code = ErrorCode::kDraining, .detail = "the server is shutting down"};
  }
  return {.code = ErrorCode::kDeadlineExceeded,
          .detail = "the request got no turn before its deadline"};
}

}  // namespace

api::Outcome<Admission::Turn> Admission::Enter(const core::CancelToken& cancel) {
  std::unique_lock lock(mutex_);
  // Nobody waits while a turn is free: Leave() passes it on.
  if (running_ < max_running_) {
    ++running_;
    return Turn(this, 0);
  }
  if (waiters_.size() >= max_queued_) {
    return Problem{.code = ErrorCode::kOverloaded,
                   .detail = "the server is at its limit of running and waiting requests",
                   .limit = static_cast<double>(max_running_ + max_queued_)};
  }
  const auto start = Clock::now();
  const auto waiter = std::make_shared<Waiter>();
  const auto place = waiters_.insert(waiters_.end(), waiter);
  while (!waiter->has_turn) {
    if (cancel.ShouldStop()) {
      waiters_.erase(place);
      return StoppedWaiting(cancel);
    }
    waiter->called.wait_until(lock, std::min(cancel.deadline(), Clock::now() + kLook));
  }
  return Turn(this, std::chrono::duration<double, std::milli>(Clock::now() - start).count());
}

void Admission::Leave() {
  std::shared_ptr<Waiter> next;
  {
    const std::lock_guard lock(mutex_);
    if (waiters_.empty()) {
      --running_;
      return;
    }
    next = std::move(waiters_.front());
    waiters_.pop_front();
    next->has_turn = true;
  }
  // Without the lock, which the waiter would meet at once.
  next->called.notify_one();
}

std::size_t Admission::running() const {
  const std::lock_guard lock(mutex_);
  return running_;
}

std::size_t Admission::queued() const {
  const std::lock_guard lock(mutex_);
  return waiters_.size();
}

}  // namespace kdray::server
