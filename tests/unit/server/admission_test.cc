// SPDX-License-Identifier: Apache-2.0
#include "server/admission.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <memory>
#include <optional>
#include <thread>
#include <vector>

#include "tests/support/wait_until.h"

namespace kdray::server {
namespace {

using namespace std::chrono_literals;
using api::ErrorCode;
using core::CancelToken;
using Clock = std::chrono::steady_clock;

void WaitFor(const auto& condition) { ASSERT_TRUE(test::WaitUntil(condition)); }

TEST(Admission, LetsAsManyInAsMayRun) {
  Admission admission(2, 0);
  auto first = admission.Enter(Lane::kShort, {});
  auto second = admission.Enter(Lane::kShort, {});
  EXPECT_TRUE(first.ok());
  EXPECT_TRUE(second.ok());
  const auto third = admission.Enter(Lane::kShort, {});
  ASSERT_FALSE(third.ok());
  EXPECT_EQ(third.problem().code, ErrorCode::kOverloaded);
}

TEST(Admission, LetsWorkWaitForWorkOfItsOwnSizeOnly) {
  Admission admission(1, 0);
  const auto long_work = admission.Enter(Lane::kLong, {});
  EXPECT_TRUE(long_work.ok());
  EXPECT_TRUE(admission.Check(Lane::kLong)) << "its queue is full";
  EXPECT_FALSE(admission.Enter(Lane::kLong, {}).ok());
  for (const Lane lane : {Lane::kShort, Lane::kMedium}) {
    EXPECT_FALSE(admission.Check(lane));
    const auto turn = admission.Enter(lane, {});
    ASSERT_TRUE(turn.ok());
    EXPECT_EQ(turn->waited_ms(), 0);
    EXPECT_EQ(admission.running(), 2U);
  }
  EXPECT_EQ(LaneOf(0), Lane::kShort);
  EXPECT_EQ(LaneOf(4096), Lane::kShort);
  EXPECT_EQ(LaneOf(100'000), Lane::kMedium);
  EXPECT_EQ(LaneOf(4'000'000), Lane::kLong);
}

TEST(Admission, HasMoreTurnsForShortWork) {
  Admission admission(1, 0, 3);
  std::vector<api::Outcome<Admission::Turn>> turns;
  for (int i = 0; i < 3; ++i) {
    turns.push_back(admission.Enter(Lane::kShort, {}));
    EXPECT_TRUE(turns.back().ok());
  }
  EXPECT_FALSE(admission.Enter(Lane::kShort, {}).ok());
  const auto long_work = admission.Enter(Lane::kLong, {});
  EXPECT_TRUE(long_work.ok());
  EXPECT_FALSE(admission.Enter(Lane::kLong, {}).ok());
}

TEST(Admission, GivesATurnBackWhenItEnds) {
  Admission admission(1, 0);
  for (int i = 0; i < 3; ++i) {
    EXPECT_TRUE(admission.Enter(Lane::kShort, {}).ok());
    EXPECT_EQ(admission.running(), 0U);
  }
}

TEST(Admission, KeepsTheOrderOfThoseWhoWait) {
  Admission admission(1, 10);
  std::optional<Admission::Turn> turn = *admission.Enter(Lane::kShort, {});
  std::vector<int> order;
  std::vector<std::jthread> threads;
  for (int i = 0; i < 5; ++i) {
    threads.emplace_back([&, i] {
      const auto mine = admission.Enter(Lane::kShort, {});
      order.push_back(i);  // one at a time
    });
    WaitFor([&] { return admission.queued() == static_cast<std::size_t>(i + 1); });
  }
  turn.reset();
  threads.clear();
  EXPECT_EQ(order, (std::vector<int>{0, 1, 2, 3, 4}));
}

TEST(Admission, TellsHowLongATurnWasWaitedFor) {
  Admission admission(1, 1);
  std::optional<Admission::Turn> turn = *admission.Enter(Lane::kShort, {});
  EXPECT_LT(turn->waited_ms(), 10);
  std::jthread thread([&] {
    const auto asked = Clock::now();
    const auto mine = admission.Enter(Lane::kShort, {});
    const std::chrono::duration<double, std::milli> at_most = Clock::now() - asked;
    EXPECT_GE(mine->waited_ms(), 60);
    EXPECT_LE(mine->waited_ms(), at_most.count());
  });
  WaitFor([&] { return admission.queued() == 1; });
  std::this_thread::sleep_for(60ms);  // real time: the wait is what is measured
  turn.reset();
}

TEST(Admission, EndsTheWaitAtTheDeadline) {
  Admission admission(1, 1);
  const auto turn = admission.Enter(Lane::kShort, {});
  const auto start = Clock::now();
  const auto late = admission.Enter(Lane::kShort, CancelToken::WithDeadline(start + 30ms));
  ASSERT_FALSE(late.ok());
  EXPECT_EQ(late.problem().code, ErrorCode::kDeadlineExceeded);
  EXPECT_LT(Clock::now() - start, 1s);
  EXPECT_EQ(admission.queued(), 0U);
}

TEST(Admission, EndsTheWaitOfAClientThatLeaves) {
  Admission admission(1, 1);
  const auto turn = admission.Enter(Lane::kShort, {});
  const auto cancel = CancelToken::Cancellable();
  std::jthread thread([&] {
    const auto left = admission.Enter(Lane::kShort, cancel);
    ASSERT_FALSE(left.ok());
    EXPECT_EQ(left.problem().code, ErrorCode::kDraining);  // its time has not passed
  });
  WaitFor([&] { return admission.queued() == 1; });
  cancel.Cancel();
  const auto start = Clock::now();
  thread.join();
  EXPECT_LT(Clock::now() - start, 250ms);
}

TEST(Admission, NeverLetsMoreRunUnderLoad) {
  Admission admission(3, 1000);
  std::atomic<int> running{0}, most{0}, turns{0};
  {
    std::vector<std::jthread> threads;
    for (int i = 0; i < 16; ++i) {
      threads.emplace_back([&] {
        for (int j = 0; j < 200; ++j) {
          const auto turn = admission.Enter(Lane::kShort, {});
          const int now = ++running;
          for (int seen = most; seen < now && !most.compare_exchange_weak(seen, now);) {
          }
          ++turns;
          --running;
        }
      });
    }
  }
  EXPECT_EQ(turns, 3200);
  EXPECT_LE(most, 3);
}

}  // namespace
}  // namespace kdray::server
