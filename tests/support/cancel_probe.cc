// SPDX-License-Identifier: Apache-2.0
#include "tests/support/cancel_probe.h"

#include <gtest/gtest.h>
#include <pthread.h>
#include <time.h>

#include <atomic>
#include <cstdlib>
#include <iostream>
#include <memory>
#include <string_view>
#include <thread>
#include <utility>

namespace kdray::test {
namespace {

std::chrono::nanoseconds ReadClock(clockid_t clock) {
  timespec time{};
  clock_gettime(clock, &time);
  return std::chrono::seconds(time.tv_sec) + std::chrono::nanoseconds(time.tv_nsec);
}

bool IsWallClock() {
  static const bool is_wall = [] {
    const char* const value = std::getenv("KDRAY_CANCEL_WALL");
    return value != nullptr && std::string_view(value) == "1";
  }();
  return is_wall;
}

}  // namespace

std::chrono::nanoseconds ThreadTime() {
  return ReadClock(IsWallClock() ? CLOCK_MONOTONIC : CLOCK_THREAD_CPUTIME_ID);
}

std::size_t CancelScale() { return IsWallClock() ? 4 : 1; }

struct CancelAfter::Watcher {
  std::atomic<bool> is_over{false};
  bool was_cancelled = false;
  std::chrono::nanoseconds cancelled_at{0};
  std::thread thread;
};

CancelAfter::CancelAfter(std::chrono::milliseconds after) : watcher_(std::make_unique<Watcher>()) {
  clockid_t clock = CLOCK_THREAD_CPUTIME_ID;
  if (IsWallClock()) {
    clock = CLOCK_MONOTONIC;
  } else {
    pthread_getcpuclockid(pthread_self(), &clock);
  }
  const std::chrono::nanoseconds begin = ThreadTime();
  watcher_->thread = std::thread([this, clock, begin, after] {
    while (!watcher_->is_over) {
      const std::chrono::nanoseconds now = ReadClock(clock);
      if (now - begin >= after) {
        watcher_->cancelled_at = now;
        watcher_->was_cancelled = true;
        token_.Cancel();
        return;
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  });
}

CancelAfter::~CancelAfter() {
  watcher_->is_over = true;
  if (watcher_->thread.joinable()) watcher_->thread.join();
}

CancelledCall CancelAfter::Finish(core::Status status) {
  const std::chrono::nanoseconds now = ThreadTime();
  watcher_->is_over = true;
  watcher_->thread.join();
  return {watcher_->was_cancelled, now - watcher_->cancelled_at, std::move(status)};
}

void ExpectPrompt(const CancelledCall& call, const std::string& what) {
  ASSERT_TRUE(call.was_cancelled) << what << ": over too early to say anything";
  EXPECT_LT(call.late, kPromptly) << what;
  using Milliseconds = std::chrono::duration<double, std::milli>;
  const double late = Milliseconds(call.late).count();
  if (IsWallClock()) std::cout << late << " ms after its cancellation: " << what << '\n';
  ASSERT_FALSE(call.status.ok()) << what;
  EXPECT_EQ(call.status.error().code, core::ErrorCode::kCancelled) << what;
}

core::CancelToken CancelledAtLook(std::uint64_t n) {
  const auto looks = std::make_shared<std::atomic<std::uint64_t>>(0);
  return core::CancelToken::When([looks, n] { return ++*looks >= n; });
}

}  // namespace kdray::test
