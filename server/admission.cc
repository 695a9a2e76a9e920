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
  const auto start = Clock::now();
  std::unique_lock lock(mutex_);
  if (running_ >= max_running_ || !queue_.empty()) {
    if (queue_.size() >= max_queued_) {
      return Problem{.code = ErrorCode::kOverloaded,
                     .detail = "the server is at its limit of running and waiting requests",
                     .limit = static_cast<double>(max_running_ + max_queued_)};
    }
    const auto place = queue_.emplace(queue_.end());
    while (running_ >= max_running_ || place != queue_.begin()) {
      if (cancel.ShouldStop()) {
        queue_.erase(place);
        changed_.notify_all();
        return StoppedWaiting(cancel);
      }
      changed_.wait_until(lock, std::min(cancel.deadline(), Clock::now() + kLook));
    }
    queue_.erase(place);
    changed_.notify_all();
  }
  ++running_;
  return Turn(this, std::chrono::duration<double, std::milli>(Clock::now() - start).count());
}

void Admission::Leave() {
  const std::lock_guard lock(mutex_);
  --running_;
  changed_.notify_all();
}

std::size_t Admission::running() const {
  const std::lock_guard lock(mutex_);
  return running_;
}

std::size_t Admission::queued() const {
  const std::lock_guard lock(mutex_);
  return queue_.size();
}

}  // namespace kdray::server
