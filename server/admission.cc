// SPDX-License-Identifier: Apache-2.0
#include "server/admission.h"

#include <algorithm>
#include <chrono>

namespace kdray::server {
namespace {

using api::ErrorCode;
using api::Problem;
using Clock = std::chrono::steady_clock;

/// Poll interval of waiters: a client's departure sets a flag without notification. A full queue
/// polls some hundred times a second, and each poll takes a processor from the work.
constexpr std::chrono::milliseconds kLook{150};

Problem StoppedWaiting(const core::CancelToken& cancel) {
  if (cancel.Reason() == core::ErrorCode::kCancelled) {
    return {.code = ErrorCode::kDraining, .detail = "the server is shutting down"};
  }
  return {.code = ErrorCode::kDeadlineExceeded,
          .detail = "the request got no turn before its deadline"};
}

}  // namespace

Lane LaneOf(std::uint64_t rays) {
  // A ray takes a third of a microsecond to several.
  constexpr std::uint64_t kShortRays = std::uint64_t{1} << 14;
  constexpr std::uint64_t kMediumRays = std::uint64_t{1} << 20;
  if (rays <= kShortRays) return Lane::kShort;
  return rays <= kMediumRays ? Lane::kMedium : Lane::kLong;
}

api::Outcome<Admission::Turn> Admission::Enter(Lane lane, const core::CancelToken& cancel) {
  std::unique_lock lock(mutex_);
  Line& line = LineOf(lane);
  // No request waits while a turn is free, because Leave() passes it on.
  if (line.running < line.turns) {
    ++line.running;
    return Turn(this, lane, 0);
  }
  if (auto problem = CheckLocked(line)) return *std::move(problem);
  const auto start = Clock::now();
  const auto waiter = std::make_shared<Waiter>();
  const auto place = line.waiters.insert(line.waiters.end(), waiter);
  while (!waiter->has_turn) {
    if (cancel.ShouldStop()) {
      line.waiters.erase(place);
      return StoppedWaiting(cancel);
    }
    waiter->called.wait_until(lock, std::min(cancel.deadline(), Clock::now() + kLook));
  }
  return Turn(this, lane, std::chrono::duration<double, std::milli>(Clock::now() - start).count());
}

api::Check Admission::Check(Lane lane) const {
  const std::lock_guard lock(mutex_);
  return CheckLocked(lines_[static_cast<std::size_t>(lane)]);
}

api::Check Admission::CheckLocked(const Line& line) const {
  if (line.running < line.turns || line.waiters.size() < max_queued_) return std::nullopt;
  return Problem{
      .code = ErrorCode::kOverloaded,
      .detail = "the server is at its limit of running and waiting requests of this size",
      .limit = static_cast<double>(line.turns + max_queued_)};
}

void Admission::Leave(Lane lane) {
  std::shared_ptr<Waiter> next;
  {
    const std::lock_guard lock(mutex_);
    Line& line = LineOf(lane);
    if (line.waiters.empty()) {
      --line.running;
      return;
    }
    next = std::move(line.waiters.front());
    line.waiters.pop_front();
    next->has_turn = true;
  }
  // Without the lock, which the waiter would meet at once.
  next->called.notify_one();
}

std::size_t Admission::running() const {
  const std::lock_guard lock(mutex_);
  std::size_t running = 0;
  for (const Line& line : lines_) running += line.running;
  return running;
}

std::size_t Admission::queued() const {
  const std::lock_guard lock(mutex_);
  std::size_t queued = 0;
  for (const Line& line : lines_) queued += line.waiters.size();
  return queued;
}

}  // namespace kdray::server
