// SPDX-License-Identifier: Apache-2.0
#include "core/base/parallel.h"

#include <gtest/gtest.h>

#include <mutex>
#include <new>
#include <set>
#include <thread>
#include <vector>

namespace kdray::core {
namespace {

struct Piece {
  std::size_t first, last;
  friend auto operator<=>(const Piece&, const Piece&) = default;
};

std::set<Piece> PiecesOf(std::size_t begin, std::size_t end, std::size_t grain) {
  std::mutex mutex;
  std::set<Piece> pieces;
  ParallelFor(begin, end, grain, [&](std::size_t first, std::size_t last) {
    const std::scoped_lock lock(mutex);
    EXPECT_TRUE(pieces.insert({first, last}).second) << "twice: " << first;
  });
  return pieces;
}

TEST(ParallelFor, CutsAtMultiplesOfTheGrain) {
  EXPECT_EQ(PiecesOf(3, 3, 4), std::set<Piece>{});
  EXPECT_EQ(PiecesOf(5, 3, 4), std::set<Piece>{});
  EXPECT_EQ(PiecesOf(3, 4, 4), (std::set<Piece>{{3, 4}}));
  EXPECT_EQ(PiecesOf(3, 7, 4), (std::set<Piece>{{3, 7}}));
  EXPECT_EQ(PiecesOf(3, 12, 4), (std::set<Piece>{{3, 7}, {7, 11}, {11, 12}}));
}

TEST(ParallelFor, ReachesTheLastNumberThereIs) {
  constexpr std::size_t kLast = static_cast<std::size_t>(-1);
  EXPECT_EQ(PiecesOf(kLast - 5, kLast, 4),
            (std::set<Piece>{{kLast - 5, kLast - 1}, {kLast - 1, kLast}}));
}

TEST(ParallelFor, VisitsEveryElementOnceInsideOtherParallelWork) {
  constexpr std::size_t kCount = 100'000;
  std::vector<int> visits(kCount);
  Arena arena(4);
  arena.Run([&] {
    ParallelInvoke(
        [&] {
          ParallelFor(0, kCount / 2, 100, [&](std::size_t first, std::size_t last) {
            for (std::size_t i = first; i < last; ++i) ++visits[i];
          });
        },
        [&] {
          ParallelFor(kCount / 2, kCount, 100, [&](std::size_t first, std::size_t last) {
            for (std::size_t i = first; i < last; ++i) ++visits[i];
          });
        });
  });
  EXPECT_EQ(visits, std::vector<int>(kCount, 1));
}

TEST(Arena, OfOneThreadDoesEverythingOnTheCallingThread) {
  Arena arena(1);
  std::set<std::thread::id> seen;
  arena.Run([&] {
    ParallelFor(0, 1000, 1,
                [&](std::size_t, std::size_t) { seen.insert(std::this_thread::get_id()); });
    ParallelInvoke([&] { seen.insert(std::this_thread::get_id()); },
                   [&] { seen.insert(std::this_thread::get_id()); });
  });
  EXPECT_EQ(seen, std::set<std::thread::id>{std::this_thread::get_id()});
}

TEST(Arena, PassesExceptionsThrough) {
  Arena arena(3);
  const auto fail_at = [&](std::size_t bad) {
    arena.Run([&] {
      ParallelFor(0, 100, 1, [&](std::size_t first, std::size_t) {
        if (first == bad) throw std::bad_alloc();
      });
    });
  };
  EXPECT_THROW(fail_at(0), std::bad_alloc);
  EXPECT_THROW(fail_at(99), std::bad_alloc);
  EXPECT_NO_THROW(fail_at(100));
  EXPECT_THROW(ParallelInvoke([] {}, [] { throw std::bad_alloc(); }), std::bad_alloc);
  EXPECT_THROW(ParallelInvoke([] { throw std::bad_alloc(); }, [] {}), std::bad_alloc);
}

}  // namespace
}  // namespace kdray::core
