// Who gets the memory of requests, and who has to give way.
#include "server/request_memory.h"

#include <gtest/gtest.h>

#include <atomic>
#include <memory>
#include <string>
#include <thread>
#include <vector>

namespace kdray::server {
namespace {

using api::ErrorCode;
using Body = RequestMemory::Body;

std::vector<std::byte> Bytes(std::size_t count, char value = 'x') {
  return std::vector<std::byte>(count, static_cast<std::byte>(value));
}

bool Append(Body& body, std::size_t count, char value = 'x') {
  const auto problem = body.Append(Bytes(count, value));
  EXPECT_TRUE(!problem || problem->code == ErrorCode::kMemoryFull);
  return !problem;
}

TEST(RequestMemory, RefusesWorkThatDoesNotFitNow) {
  RequestMemory memory(100);
  const auto first = memory.Take(60);
  EXPECT_TRUE(first.ok());
  EXPECT_TRUE(memory.Take(40).ok());
  const auto refused = memory.Take(41);
  ASSERT_FALSE(refused.ok());
  EXPECT_EQ(refused.problem().code, ErrorCode::kMemoryFull);
}

TEST(RequestMemory, TakesBackWhatIsNoLongerHeld) {
  RequestMemory memory(100);
  {
    RequestMemory::Share share = *memory.Take(100);
    const RequestMemory::Share moved = std::move(share);
    EXPECT_EQ(memory.used(), 100U);
  }
  EXPECT_EQ(memory.used(), 0U);
}

TEST(RequestMemory, AShareGrowsAsFarAsThereIsRoomAndShrinksAtOnce) {
  RequestMemory memory(100);
  RequestMemory::Share share = *memory.Take(40);
  const RequestMemory::Share other = *memory.Take(40);
  EXPECT_FALSE(share.Grow(20));
  const api::Check refused = share.Grow(1);
  ASSERT_TRUE(refused);
  EXPECT_EQ(refused->code, ErrorCode::kMemoryFull);
  EXPECT_EQ(share.bytes(), 60U);
  share.ShrinkTo(70);
  EXPECT_EQ(memory.used(), 100U) << "it has less";
  share.ShrinkTo(5);
  EXPECT_EQ(memory.used(), 45U);
}

TEST(RequestMemory, AShareThatIsAloneGrowsBeyondTheLimit) {
  RequestMemory memory(100);
  RequestMemory::Share share = *memory.Take(40);
  EXPECT_FALSE(share.Grow(1000));
  EXPECT_EQ(memory.used(), 1040U);
}

TEST(RequestMemory, LetsALargeRequestInAlone) {
  RequestMemory memory(100);
  const auto large = memory.Take(1'000'000);
  EXPECT_TRUE(large.ok());
  EXPECT_FALSE(memory.Take(1).ok());
}

TEST(RequestMemory, ABodyHoldsWhatHasArrivedAndNoMore) {
  RequestMemory memory(100);
  {
    Body body(&memory, 3);
    EXPECT_EQ(memory.used(), 0U);
    EXPECT_TRUE(Append(body, 10));
    EXPECT_EQ(memory.used(), 30U);
    EXPECT_TRUE(memory.Take(70).ok());
  }
  EXPECT_EQ(memory.used(), 0U);
}

TEST(RequestMemory, ACompleteBodyKeepsItsBytesAndItsShare) {
  RequestMemory memory(100);
  {
    auto body = std::make_unique<Body>(&memory, 2);
    EXPECT_TRUE(Append(*body, 5, 'a'));
    EXPECT_TRUE(Append(*body, 5, 'b'));
    const auto whole = body->Finish();
    ASSERT_TRUE(whole.ok());
    body.reset();
    EXPECT_EQ(whole->text.view(), "aaaaabbbbb");
    EXPECT_EQ(memory.used(), 20U);
  }
  EXPECT_EQ(memory.used(), 0U);
}

TEST(RequestMemory, TheNewestBodyGivesWayToAnOlderOne) {
  RequestMemory memory(100);
  Body oldest(&memory, 1);
  Body middle(&memory, 1);
  Body newest(&memory, 1);
  EXPECT_TRUE(Append(newest, 30));
  EXPECT_TRUE(Append(middle, 40));
  EXPECT_TRUE(Append(oldest, 50)) << "the newest gave way, nobody waited";
  EXPECT_EQ(memory.used(), 90U) << "its bytes are free before it notices";
  EXPECT_TRUE(Append(middle, 10)) << "the next newest did not have to";
  EXPECT_FALSE(Append(newest, 1));
  const auto refused = newest.Finish();
  ASSERT_FALSE(refused.ok());
  EXPECT_EQ(refused.problem().code, ErrorCode::kMemoryFull);
  EXPECT_TRUE(oldest.Finish().ok());
  EXPECT_TRUE(middle.Finish().ok());
}

TEST(RequestMemory, TheNewestBodyIsTheOneRefusedWhenItMeetsAFullBudget) {
  RequestMemory memory(100);
  Body older(&memory, 1);
  Body newest(&memory, 1);
  EXPECT_TRUE(Append(older, 80));
  EXPECT_FALSE(Append(newest, 30));
  EXPECT_TRUE(Append(older, 20));
}

TEST(RequestMemory, NobodyGivesWayInVain) {
  RequestMemory memory(100);
  const auto work = memory.Take(70);
  Body older(&memory, 1);
  Body newest(&memory, 1);
  EXPECT_TRUE(Append(newest, 20));
  EXPECT_FALSE(Append(older, 40)) << "even with the newest gone there would not be enough";
  EXPECT_TRUE(Append(newest, 10));
}

TEST(RequestMemory, ACompleteBodyDoesNotGiveWay) {
  RequestMemory memory(100);
  Body older(&memory, 1);
  auto newer = std::make_unique<Body>(&memory, 1);
  EXPECT_TRUE(Append(*newer, 60));
  const auto whole = newer->Finish();
  EXPECT_TRUE(whole.ok());
  EXPECT_FALSE(Append(older, 50));
}

TEST(RequestMemory, ALargeBodyGrowsBeyondTheBudgetWhileItIsAlone) {
  RequestMemory memory(100);
  Body large(&memory, 1);
  EXPECT_TRUE(Append(large, 90));
  EXPECT_TRUE(Append(large, 90));
  EXPECT_FALSE(memory.Take(1).ok());
  Body small(&memory, 1);
  EXPECT_FALSE(Append(small, 1)) << "it is the newest";
  EXPECT_TRUE(Append(large, 90));
}

TEST(RequestMemory, ADeclaredLengthTakesNothing) {
  RequestMemory memory(100);
  EXPECT_FALSE(memory.Check(1'000'000)) << "nothing is held, so it may come in alone";
  EXPECT_EQ(memory.used(), 0U);
  const auto work = memory.Take(50);
  EXPECT_FALSE(memory.Check(50));
  const auto problem = memory.Check(51);
  ASSERT_TRUE(problem);
  EXPECT_EQ(problem->code, ErrorCode::kMemoryFull);
  EXPECT_EQ(memory.used(), 50U);
}

TEST(RequestMemory, ManyBodiesAtOnceLeaveNothingBehind) {
  RequestMemory memory(10'000);
  std::atomic<int> finished{0};
  {
    std::vector<std::jthread> clients;
    for (int client = 0; client < 8; ++client) {
      clients.emplace_back([&] {
        for (int i = 0; i < 200; ++i) {
          Body body(&memory, 3);
          bool ok = true;
          for (int piece = 0; ok && piece < 10; ++piece) ok = Append(body, 97);
          if (ok && body.Finish().ok()) ++finished;
        }
      });
    }
  }
  EXPECT_EQ(memory.used(), 0U);
  EXPECT_GE(finished, 200) << "whoever is the oldest gets through";
}

}  // namespace
}  // namespace kdray::server
