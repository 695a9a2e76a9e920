// SPDX-License-Identifier: Apache-2.0
#include "server/block_pool.h"

#include <gtest/gtest.h>
#include <sys/mman.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstring>
#include <set>
#include <thread>
#include <vector>

#include "tests/support/wait_until.h"

namespace kdray::server {
namespace {

using std::chrono::milliseconds;
constexpr std::size_t kBlock = BlockPool::kBlockBytes;
constexpr milliseconds kLong{1'000'000};

std::vector<char*> TakeAndTouch(BlockPool& pool, std::size_t count) {
  std::vector<char*> blocks;
  for (std::size_t i = 0; i < count; ++i) {
    blocks.push_back(pool.Take());
    std::memset(blocks.back(), 1, kBlock);
  }
  return blocks;
}

void GiveBack(BlockPool& pool, const std::vector<char*>& blocks) {
  for (char* const block : blocks) pool.GiveBack(block);
}

/// How many of the blocks the process still has; the others went back to the system.
std::size_t CountMapped(const std::vector<char*>& blocks) {
  return static_cast<std::size_t>(std::count_if(blocks.begin(), blocks.end(), [](char* block) {
    unsigned char resident = 0;
    return mincore(block, 1, &resident) == 0;  // else ENOMEM
  }));
}

TEST(BlockPool, HandsOutBlocksThatCameBackBeforeNewOnes) {
  BlockPool pool(4 * kBlock, kLong);
  const std::vector<char*> first = TakeAndTouch(pool, 3);
  EXPECT_EQ(std::set<char*>(first.begin(), first.end()).size(), 3U);
  for (char* const block : first) EXPECT_EQ(reinterpret_cast<std::uintptr_t>(block) % kBlock, 0U);
  GiveBack(pool, first);
  EXPECT_EQ(pool.kept_bytes(), 3 * kBlock);
  const std::vector<char*> again = TakeAndTouch(pool, 3);
  EXPECT_EQ(std::set<char*>(again.begin(), again.end()),
            std::set<char*>(first.begin(), first.end()));
  EXPECT_EQ(pool.kept_bytes(), 0U);
  GiveBack(pool, again);
}

TEST(BlockPool, KeepsNoMoreThanItsLimitAndReturnsTheRestToTheSystem) {
  BlockPool pool(2 * kBlock + kBlock / 2, kLong);
  const std::vector<char*> blocks = TakeAndTouch(pool, 8);
  EXPECT_EQ(CountMapped(blocks), 8U);
  GiveBack(pool, blocks);
  EXPECT_EQ(pool.kept_bytes(), 2 * kBlock);
  EXPECT_EQ(CountMapped(blocks), 2U);
}

TEST(BlockPool, GivesBlocksUpAtOnceWhenLessMayBeKept) {
  BlockPool pool(8 * kBlock, kLong);
  const std::vector<char*> blocks = TakeAndTouch(pool, 8);
  GiveBack(pool, blocks);
  EXPECT_EQ(CountMapped(blocks), 8U);
  pool.KeepAtMost(3 * kBlock - 1);
  EXPECT_EQ(pool.kept_bytes(), 2 * kBlock);
  EXPECT_EQ(CountMapped(blocks), 2U);
  GiveBack(pool, TakeAndTouch(pool, 4));
  EXPECT_EQ(pool.kept_bytes(), 2 * kBlock) << "the limit stays";
  pool.KeepAtMost(100 * kBlock);
  GiveBack(pool, TakeAndTouch(pool, 9));
  EXPECT_EQ(pool.kept_bytes(), 8 * kBlock) << "but never more than the first one";
}

TEST(BlockPool, GivesEverythingBackWhenNobodyUsesIt) {
  BlockPool pool(8 * kBlock, milliseconds(20));
  for (int round = 0; round < 2; ++round) {
    const std::vector<char*> blocks = TakeAndTouch(pool, 5);
    GiveBack(pool, blocks);
    EXPECT_TRUE(test::WaitUntil([&] { return pool.kept_bytes() == 0; })) << round;
    EXPECT_EQ(CountMapped(blocks), 0U);
  }
}

TEST(BlockPool, WithoutALimitKeepsNothing) {
  BlockPool pool(kBlock - 1, kLong);
  GiveBack(pool, TakeAndTouch(pool, 2));
  EXPECT_EQ(pool.kept_bytes(), 0U);
}

TEST(BlockPool, ServesManyThreadsAtOnce) {
  BlockPool pool(4 * kBlock, milliseconds(1));
  {
    std::vector<std::jthread> threads;
    for (int thread = 0; thread < 4; ++thread) {
      threads.emplace_back([&pool, thread] {
        for (int i = 0; i < 200; ++i) {
          char* const block = pool.Take();
          const int value = 4 * i + thread;
          std::memcpy(block, &value, sizeof(value));
          if (i % 16 == thread) pool.KeepAtMost(static_cast<std::uint64_t>(i % 5) * kBlock);
          std::this_thread::yield();
          int seen = 0;
          std::memcpy(&seen, block, sizeof(seen));
          EXPECT_EQ(seen, value) << "nobody else has the block";
          pool.GiveBack(block);
        }
      });
    }
  }
  EXPECT_LE(pool.kept_bytes(), 4 * kBlock);
}

}  // namespace
}  // namespace kdray::server
