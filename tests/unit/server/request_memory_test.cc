// SPDX-License-Identifier: Apache-2.0
// Who gets the memory of requests, and who has to give way.
#include "server/request_memory.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

namespace kdray::server {
namespace {

using api::ErrorCode;
using Body = RequestMemory::Body;
using Share = RequestMemory::Share;

// Of 6400 bytes, a small request has at most 100; large ones leave it 800, and large bodies 1600.
constexpr std::uint64_t kOwn = 6400;
constexpr ErrorCode kNever = ErrorCode::kImageTooLarge;

std::vector<std::byte> Bytes(std::size_t count, char value = 'x') {
  return std::vector<std::byte>(count, static_cast<std::byte>(value));
}

bool Append(Body& body, std::size_t count, char value = 'x') {
  const auto problem = body.Append(Bytes(count, value));
  EXPECT_TRUE(!problem || problem->code == ErrorCode::kMemoryFull);
  return !problem;
}

std::optional<Share> TakeIfFree(RequestMemory& memory, std::uint64_t bytes) {
  auto share = memory.Take(bytes, kNever);
  if (!share) {
    EXPECT_EQ(share.problem().code, ErrorCode::kMemoryFull);
    return std::nullopt;
  }
  return *std::move(share);
}

TEST(RequestMemory, RefusesWorkThatDoesNotFitNow) {
  RequestMemory memory(kOwn);
  const auto first = TakeIfFree(memory, 4000);
  EXPECT_TRUE(first);
  EXPECT_TRUE(TakeIfFree(memory, 1600));
  EXPECT_FALSE(TakeIfFree(memory, 1601));
  EXPECT_EQ(memory.used(), 4000U);
}

// A client has its answer before the answer's memory is returned, and asks again.
TEST(RequestMemory, WaitsForMemoryThatIsAboutToBeReturned) {
  RequestMemory memory(kOwn, nullptr, {.settle = std::chrono::seconds(10)});
  for (int round = 0; round < 3; ++round) {
    std::optional<Share> sent = TakeIfFree(memory, 5000);
    std::jthread sender([&] {
      std::this_thread::sleep_for(std::chrono::milliseconds(2));  // of an answer's last bytes
      sent.reset();
    });
    switch (round) {
      case 0:
        EXPECT_TRUE(TakeIfFree(memory, 5000));
        break;
      case 1:
        EXPECT_EQ(memory.CheckBody(4000), std::nullopt);
        break;
      default: {
        Body body(&memory);
        EXPECT_TRUE(Append(body, 4000));
      }
    }
  }
  EXPECT_EQ(memory.used(), 0U);
}

TEST(RequestMemory, RefusesForGoodWhatCanNeverFit) {
  RequestMemory memory(kOwn);
  EXPECT_TRUE(TakeIfFree(memory, 5600));
  const auto refused = memory.Take(5601, kNever);
  ASSERT_FALSE(refused.ok());
  EXPECT_EQ(refused.problem().code, kNever);
  EXPECT_EQ(refused.problem().limit, 5600);
  EXPECT_EQ(refused.problem().actual, 5601);
  Share share = *TakeIfFree(memory, 5000);
  const api::Check too_large = share.Grow(601, kNever);
  ASSERT_TRUE(too_large);
  EXPECT_EQ(too_large->code, kNever);
  EXPECT_EQ(share.bytes(), 5000U);
}

TEST(RequestMemory, LeavesAPartToSmallRequests) {
  RequestMemory memory(kOwn);
  const auto large = TakeIfFree(memory, 5600);
  std::vector<Share> small;
  for (int i = 0; i < 8; ++i) {
    auto share = TakeIfFree(memory, 100);
    ASSERT_TRUE(share) << i;
    small.push_back(*std::move(share));
  }
  EXPECT_FALSE(TakeIfFree(memory, 1));
  EXPECT_TRUE(memory.CheckBody(1));
  small.pop_back();
  EXPECT_FALSE(memory.CheckBody(100));
}

TEST(RequestMemory, TakesBackWhatIsNoLongerHeld) {
  RequestMemory memory(kOwn);
  {
    Share share = *TakeIfFree(memory, 100);
    const Share moved = std::move(share);
    EXPECT_EQ(memory.used(), 100U);
  }
  EXPECT_EQ(memory.used(), 0U);
}

TEST(RequestMemory, AShareGrowsAsFarAsThereIsRoomAndShrinksAtOnce) {
  RequestMemory memory(kOwn);
  Share share = *TakeIfFree(memory, 2000);
  const Share other = *TakeIfFree(memory, 2000);
  EXPECT_FALSE(share.Grow(1600, kNever));
  const api::Check refused = share.Grow(1, kNever);
  ASSERT_TRUE(refused);
  EXPECT_EQ(refused->code, ErrorCode::kMemoryFull);
  EXPECT_EQ(share.bytes(), 3600U);
  share.ShrinkTo(3700);
  EXPECT_EQ(memory.used(), 5600U) << "it has less";
  share.ShrinkTo(5);
  EXPECT_EQ(memory.used(), 2005U);
}

TEST(RequestMemory, BorrowsWhatTreesDoNotNeedAndGivesItBack) {
  core::MemoryBudget trees(3 * kOwn);
  RequestMemory memory(kOwn, &trees);
  {
    auto tree = trees.TryReserve(2 * kOwn + 1);
    ASSERT_TRUE(tree);
    EXPECT_FALSE(TakeIfFree(memory, 2 * kOwn - 800)) << "a tree in use needs it";
    EXPECT_TRUE(TakeIfFree(memory, kOwn)) << "some of it is free";
  }
  EXPECT_EQ(memory.borrowed(), 0U);
  {
    Share large = *TakeIfFree(memory, 2 * kOwn - 800);
    EXPECT_EQ(memory.borrowed(), kOwn);
    EXPECT_EQ(trees.used(), kOwn);
    EXPECT_FALSE(TakeIfFree(memory, 1000));
    EXPECT_TRUE(TakeIfFree(memory, 100)) << "small requests have their part";
    large.ShrinkTo(kOwn);
    EXPECT_EQ(memory.borrowed(), 800U);
    EXPECT_FALSE(memory.CheckBody(100));
  }
  EXPECT_EQ(trees.used(), 0U);
  const auto refused = memory.Take(2 * kOwn - 799, kNever);
  ASSERT_FALSE(refused.ok());
  EXPECT_EQ(refused.problem().code, kNever);
}

// A large tree leaves little to its own queries, however idle the server is.
TEST(RequestMemory, WhatCannotFitBesideItsOwnTreeNeverFits) {
  core::MemoryBudget trees(3 * kOwn);
  RequestMemory memory(kOwn, &trees);
  constexpr std::uint64_t kTree = 2 * kOwn + 100;
  const auto tree = trees.TryReserve(kTree);
  ASSERT_TRUE(tree);
  const auto refused = memory.Take(2 * kOwn - 899, kNever, kTree);
  ASSERT_FALSE(refused.ok());
  EXPECT_EQ(refused.problem().code, kNever);
  EXPECT_EQ(refused.problem().limit, 2 * kOwn - 900);
  EXPECT_NE(refused.problem().detail.find("beside the tree"), std::string::npos);
  {
    auto most = memory.Take(2 * kOwn - 900, kNever, kTree);
    ASSERT_TRUE(most.ok()) << "all that the tree leaves";
    const api::Check more = most->Grow(1, kNever);
    ASSERT_TRUE(more);
    EXPECT_EQ(more->code, kNever);
  }
  const auto other = memory.Take(2 * kOwn - 899, kNever, kTree - 100);
  ASSERT_FALSE(other.ok());
  EXPECT_EQ(other.problem().code, ErrorCode::kMemoryFull) << "the tree in use is another's";
}

TEST(RequestMemory, BodiesDoNotBorrow) {
  core::MemoryBudget trees(3 * kOwn);
  RequestMemory memory(kOwn, &trees);
  Body body(&memory);
  EXPECT_TRUE(Append(body, 4800));
  const auto problem = body.Append(Bytes(1));
  ASSERT_TRUE(problem);
  EXPECT_EQ(problem->code, ErrorCode::kBodyTooLarge);
  EXPECT_EQ(trees.used(), 0U);
}

TEST(RequestMemory, ABodyHoldsWhatHasArrivedAndNoMore) {
  RequestMemory memory(kOwn);
  {
    Body body(&memory);
    EXPECT_EQ(memory.used(), 0U);
    EXPECT_TRUE(Append(body, 10));
    EXPECT_EQ(memory.used(), 10U);
    EXPECT_TRUE(TakeIfFree(memory, 5000));
  }
  EXPECT_EQ(memory.used(), 0U);
}

TEST(RequestMemory, ACompleteBodyKeepsItsBytesAndItsShare) {
  RequestMemory memory(kOwn);
  {
    auto body = std::make_unique<Body>(&memory);
    EXPECT_TRUE(Append(*body, 5, 'a'));
    EXPECT_TRUE(Append(*body, 5, 'b'));
    const auto whole = body->Finish();
    ASSERT_TRUE(whole.ok());
    body.reset();
    EXPECT_EQ(whole->text.view(), "aaaaabbbbb");
    EXPECT_EQ(memory.used(), 10U);
  }
  EXPECT_EQ(memory.used(), 0U);
}

TEST(RequestMemory, TheNewestBodyGivesWayToAnOlderOne) {
  RequestMemory memory(kOwn);
  Body oldest(&memory);
  Body middle(&memory);
  Body newest(&memory);
  EXPECT_TRUE(Append(newest, 1300));
  EXPECT_TRUE(Append(middle, 1900));
  EXPECT_TRUE(Append(oldest, 2400)) << "the newest gave way, so no body waited";
  EXPECT_EQ(memory.used(), 4300U) << "its bytes are free before it notices";
  EXPECT_TRUE(Append(middle, 500)) << "the next newest did not have to";
  EXPECT_FALSE(Append(newest, 1));
  const auto refused = newest.Finish();
  ASSERT_FALSE(refused.ok());
  EXPECT_EQ(refused.problem().code, ErrorCode::kMemoryFull);
  EXPECT_TRUE(oldest.Finish().ok());
  EXPECT_TRUE(middle.Finish().ok());
}

TEST(RequestMemory, TheNewestBodyIsTheOneRefusedWhenItMeetsAFullBudget) {
  RequestMemory memory(kOwn);
  Body older(&memory);
  Body newest(&memory);
  EXPECT_TRUE(Append(older, 4000));
  EXPECT_FALSE(Append(newest, 1000));
  EXPECT_TRUE(Append(older, 800));
}

TEST(RequestMemory, NobodyGivesWayInVain) {
  RequestMemory memory(kOwn);
  const auto work = TakeIfFree(memory, 3800);
  Body older(&memory);
  Body newest(&memory);
  EXPECT_TRUE(Append(newest, 900));
  EXPECT_FALSE(Append(older, 1001)) << "even with the newest gone there would not be enough";
  EXPECT_TRUE(Append(newest, 100));
}

TEST(RequestMemory, ACompleteBodyDoesNotGiveWay) {
  RequestMemory memory(kOwn);
  Body older(&memory);
  auto newer = std::make_unique<Body>(&memory);
  EXPECT_TRUE(Append(*newer, 3000));
  const auto whole = newer->Finish();
  EXPECT_TRUE(whole.ok());
  EXPECT_FALSE(Append(older, 2000));
}

TEST(RequestMemory, ADeclaredLengthTakesNothing) {
  RequestMemory memory(kOwn);
  const auto never = memory.CheckBody(4801);
  ASSERT_TRUE(never);
  EXPECT_EQ(never->code, ErrorCode::kBodyTooLarge);
  EXPECT_FALSE(memory.CheckBody(4800));
  EXPECT_EQ(memory.used(), 0U);
  const auto work = TakeIfFree(memory, 2000);
  EXPECT_FALSE(memory.CheckBody(2800));
  const auto full = memory.CheckBody(2801);
  ASSERT_TRUE(full);
  EXPECT_EQ(full->code, ErrorCode::kMemoryFull);
  EXPECT_EQ(memory.used(), 2000U);
}

constexpr std::uint64_t kBlock = BlockPool::kBlockBytes;

TEST(RequestMemory, ABodyMayBecomeBlocksInPlaceOfItsText) {
  RequestMemory memory(64 * kBlock);
  {
    std::optional<Body::Whole> whole;
    {
      Body body(&memory);
      EXPECT_TRUE(Append(body, 1000, 'a'));
      {
        const auto text = body.TakeText();
        ASSERT_TRUE(text.ok());
        EXPECT_EQ(text->view(), std::string(1000, 'a'));
        EXPECT_EQ(memory.used(), 1000U);
        for (int i = 0; i < 2; ++i) ASSERT_FALSE(body.AddBlock());
        EXPECT_EQ(memory.used(), 1000 + 2 * kBlock) << "a block is charged whole";
        body.ReturnText(text->size());
      }
      EXPECT_FALSE(body.WriteToBlock([](api::ByteBlock* block) {
        block->Extend(3);
        std::copy_n("xyz", 3, block->data());
      }));
      auto finished = body.Finish();
      ASSERT_TRUE(finished.ok());
      whole.emplace(*std::move(finished));
    }
    EXPECT_EQ(whole->text.size(), 0U);
    ASSERT_EQ(whole->blocks.size(), 2U);
    EXPECT_EQ(whole->blocks[0].view(), "");
    EXPECT_EQ(whole->blocks[1].view(), "xyz");
    EXPECT_EQ(whole->share.bytes(), 2 * kBlock);
    EXPECT_EQ(memory.used(), 2 * kBlock);
  }
  EXPECT_EQ(memory.used(), 0U);
}

TEST(RequestMemory, ADroppedBodyGivesItsBlocksBackAtOnce) {
  RequestMemory memory(16 * kBlock);
  Body older(&memory);
  Body newest(&memory);
  for (int i = 0; i < 6; ++i) ASSERT_FALSE(newest.AddBlock());
  for (int i = 0; i < 12; ++i) EXPECT_FALSE(older.AddBlock()) << i;
  EXPECT_EQ(memory.used(), 12 * kBlock);
  const auto refused = newest.AddBlock();
  ASSERT_TRUE(refused);
  EXPECT_EQ(refused->code, ErrorCode::kMemoryFull);
  EXPECT_TRUE(newest.WriteToBlock([](api::ByteBlock*) { FAIL() << "it has no block any more"; }));
  EXPECT_TRUE(newest.LookAtText([](std::string_view) { FAIL(); }));
  EXPECT_FALSE(newest.TakeText().ok());
  newest.ReturnText(5);
  EXPECT_EQ(memory.used(), 12 * kBlock);
  EXPECT_TRUE(older.Finish().ok());
}

TEST(RequestMemory, BlocksThatNobodyUsesGiveWayToRequests) {
  RequestMemory memory(16 * kBlock, nullptr, {.pool_idle = std::chrono::hours(1)});
  {
    Body body(&memory);
    for (int i = 0; i < 6; ++i) ASSERT_FALSE(body.AddBlock());
  }
  EXPECT_EQ(memory.used(), 0U);
  EXPECT_EQ(memory.kept(), 2 * kBlock) << "an eighth";
  {
    const auto half = TakeIfFree(memory, 13 * kBlock);
    EXPECT_EQ(memory.kept(), 2 * kBlock);
    const auto small = TakeIfFree(memory, kBlock / 4);
    const auto another = TakeIfFree(memory, kBlock / 4);
    EXPECT_EQ(memory.kept(), 2 * kBlock);
    std::vector<Share> rest;
    for (int i = 0; i < 3; ++i) {
      auto share = TakeIfFree(memory, kBlock / 4);
      ASSERT_TRUE(share);
      rest.push_back(*std::move(share));
      EXPECT_LE(memory.used() + memory.kept(), 16 * kBlock);
    }
    EXPECT_EQ(memory.kept(), kBlock);
  }
}

TEST(RequestMemory, ManyBodiesAtOnceLeaveNothingBehind) {
  RequestMemory memory(10'000);
  std::atomic<int> finished{0};
  {
    std::vector<std::jthread> clients;
    for (int client = 0; client < 8; ++client) {
      clients.emplace_back([&] {
        for (int i = 0; i < 200; ++i) {
          Body body(&memory);
          bool ok = true;
          for (int piece = 0; ok && piece < 10; ++piece) ok = Append(body, 291);
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
