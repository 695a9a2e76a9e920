// SPDX-License-Identifier: Apache-2.0
// Who gets memory, who waits for it, and how long.
#include "core/library/memory_budget.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <memory>
#include <mutex>
#include <new>
#include <optional>
#include <thread>

namespace kdray::core {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

/// A clock that stands until a test moves it.
class MovableClock {
 public:
  MemoryBudget::Now now() {
    return [this] { return MemoryBudget::Clock::time_point(milliseconds(ms_)); };
  }
  void Move(milliseconds by) { ms_ += by.count(); }

 private:
  std::atomic<std::int64_t> ms_{1'000'000};
};

constexpr WaitingLine::Rule kRule{
    .patience = seconds(5), .turn = seconds(2), .give_up = seconds(60), .most_waiting = 3};

/// A thread that reserves, and keeps what it got until it is told to let go.
class Waiter {
 public:
  Waiter(MemoryBudget* budget, std::uint64_t bytes, CancelToken cancel = CancelToken())
      : thread_([=, this] {
          auto charge = budget->Reserve(bytes, cancel, &waits_);
          if (!charge.ok()) code_ = charge.error().code;
          done_ = true;
          while (!let_go_) std::this_thread::yield();
        }) {
    while (!waits_ && !done_) std::this_thread::yield();
  }
  ~Waiter() { LetGo(); }

  bool done() const { return done_; }
  void Join() {
    while (!done_) std::this_thread::yield();
  }
  void LetGo() {
    let_go_ = true;
    if (thread_.joinable()) thread_.join();
  }
  std::optional<ErrorCode> code() const { return code_; }

 private:
  std::atomic<bool> waits_{false}, done_{false}, let_go_{false};
  std::optional<ErrorCode> code_;  // written before done_
  std::thread thread_;
};

TEST(MemoryBudget, RefusesWhatCouldNeverFit) {
  MemoryBudget budget(100);
  const auto charge = budget.Reserve(101, CancelToken());
  ASSERT_FALSE(charge.ok());
  EXPECT_EQ(charge.error().code, ErrorCode::kMeshTooLarge);
  EXPECT_TRUE(budget.Reserve(100, CancelToken()).ok());
}

TEST(MemoryBudget, GrowsShrinksAndSplitsACharge) {
  MemoryBudget budget(100);
  std::optional<MemoryCharge> charge = budget.TryReserve(40);
  ASSERT_TRUE(charge.has_value());
  EXPECT_TRUE(charge->Grow(90));
  EXPECT_FALSE(charge->Grow(101));
  EXPECT_EQ(budget.used(), 90u);
  {
    const MemoryCharge part = charge->Split(30);
    EXPECT_EQ(part.bytes(), 30u);
    EXPECT_EQ(charge->bytes(), 60u);
    EXPECT_EQ(budget.used(), 90u);
  }
  EXPECT_EQ(budget.used(), 60u);
  charge->Shrink(10);
  EXPECT_EQ(budget.used(), 10u);
  charge.reset();
  EXPECT_EQ(budget.used(), 0u);
}

TEST(MemoryBudget, WaitsUntilMemoryIsGivenBack) {
  MemoryBudget budget(100);
  std::optional<MemoryCharge> first = budget.TryReserve(80);
  Waiter second(&budget, 50);
  EXPECT_FALSE(second.done());
  first.reset();
  second.Join();
  EXPECT_EQ(second.code(), std::nullopt);
  second.LetGo();
  EXPECT_EQ(budget.used(), 0u);
}

TEST(MemoryBudget, SmallWorkPassesLargeWorkThatWaits) {
  MovableClock clock;
  MemoryBudget budget(100, kRule, clock.now());
  std::optional<MemoryCharge> held = budget.TryReserve(60);
  Waiter large(&budget, 90);
  clock.Move(milliseconds(4999));
  EXPECT_TRUE(budget.TryReserve(40).has_value());
  EXPECT_TRUE(budget.Reserve(40, CancelToken()).ok());
  EXPECT_FALSE(large.done());
  held.reset();
  large.Join();
  EXPECT_EQ(large.code(), std::nullopt);
}

TEST(MemoryBudget, LargeWorkHasItsTurnOnceItWasPatient) {
  MovableClock clock;
  MemoryBudget budget(100, kRule, clock.now());
  std::optional<MemoryCharge> held = budget.TryReserve(30);
  Waiter large(&budget, 90);
  Waiter small(&budget, 80);
  clock.Move(seconds(5));
  EXPECT_FALSE(budget.TryReserve(10).has_value()) << "what is given back is for the large one";
  EXPECT_TRUE(held->Grow(40)) << "work under way goes on";
  held.reset();
  large.Join();
  EXPECT_FALSE(small.done());
  large.LetGo();
  small.Join();
  EXPECT_EQ(small.code(), std::nullopt);
}

TEST(MemoryBudget, ATurnThatIsNotEnoughEndsAndGoesToTheNextAndComesAgain) {
  MovableClock clock;
  MemoryBudget budget(100, kRule, clock.now());
  std::optional<MemoryCharge> held = budget.TryReserve(30);
  Waiter first(&budget, 90);
  Waiter second(&budget, 80);
  clock.Move(seconds(5));
  EXPECT_FALSE(budget.TryReserve(1).has_value()) << "the turn of the first";
  clock.Move(seconds(2));
  EXPECT_FALSE(budget.TryReserve(1).has_value()) << "the turn of the second";
  clock.Move(seconds(2));
  EXPECT_TRUE(budget.TryReserve(1).has_value()) << "both have to be patient again";
  clock.Move(seconds(3));
  EXPECT_FALSE(budget.TryReserve(1).has_value()) << "the first again, 5 s after its turn";
  held.reset();
  first.Join();
  EXPECT_FALSE(second.done());
  first.LetGo();
  second.Join();
}

TEST(MemoryBudget, NobodyWaitsLongerThanIsStated) {
  MovableClock clock;
  MemoryBudget budget(100, kRule, clock.now());
  const std::optional<MemoryCharge> held = budget.TryReserve(60);
  Waiter large(&budget, 90);
  clock.Move(milliseconds(59'999));
  EXPECT_FALSE(large.done());
  clock.Move(milliseconds(1));
  large.Join();
  EXPECT_EQ(large.code(), ErrorCode::kMemoryFull);
  EXPECT_TRUE(budget.TryReserve(40).has_value()) << "and the turn has ended";
}

TEST(MemoryBudget, WhenTooManyWaitTheNextIsRefusedAtOnce) {
  MemoryBudget budget(100, kRule);
  std::optional<MemoryCharge> held = budget.TryReserve(60);
  const CancelToken stop = CancelToken::Cancellable();
  Waiter first(&budget, 90, stop);
  Waiter second(&budget, 90, stop);
  Waiter third(&budget, 90, stop);
  const auto fourth = budget.Reserve(90, CancelToken());
  ASSERT_FALSE(fourth.ok());
  EXPECT_EQ(fourth.error().code, ErrorCode::kMemoryFull);
  EXPECT_TRUE(budget.Reserve(40, CancelToken()).ok()) << "what fits need not wait";
  stop.Cancel();
}

TEST(MemoryBudget, StopsWaitingWhenAskedTo) {
  MemoryBudget budget(100);
  const std::optional<MemoryCharge> held = budget.TryReserve(60);
  const auto late = budget.Reserve(
      50, CancelToken::WithDeadline(std::chrono::steady_clock::now() + milliseconds(5)));
  ASSERT_FALSE(late.ok());
  EXPECT_EQ(late.error().code, ErrorCode::kDeadlineExceeded);
  const CancelToken token = CancelToken::Cancellable();
  token.Cancel();
  const auto cancelled = budget.Reserve(50, token);
  ASSERT_FALSE(cancelled.ok());
  EXPECT_EQ(cancelled.error().code, ErrorCode::kCancelled);
  EXPECT_TRUE(budget.TryReserve(40).has_value()) << "no waiter is left";
}

TEST(MemoryBudget, AFailureWhileOneWaitsLeavesNobodyInTheLine) {
  MovableClock clock;
  MemoryBudget budget(100, kRule, clock.now());
  int asked = 0;
  budget.set_reclaim([&](std::uint64_t) -> std::uint64_t {
    if (++asked == 2) throw std::bad_alloc();
    return 0;
  });
  {
    const std::optional<MemoryCharge> held = budget.TryReserve(60);
    EXPECT_THROW((void)budget.Reserve(50, CancelToken()), std::bad_alloc);
  }
  clock.Move(seconds(5));
  EXPECT_TRUE(budget.TryReserve(100).has_value());
}

}  // namespace
}  // namespace kdray::core
