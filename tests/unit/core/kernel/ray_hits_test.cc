// SPDX-License-Identifier: Apache-2.0
#include "core/kernel/ray_hits.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <random>
#include <set>
#include <span>
#include <thread>
#include <vector>

#include "core/kernel/triangle_set.h"
#include "tests/support/seed.h"

namespace kdray::core {
namespace {

TEST(TriangleSet, HoldsWhatWasInsertedSinceItWasCleared) {
  auto engine = test::RandomEngine(2300);
  TriangleSet set;
  for (const std::size_t triangles : {1u, 40u, 2'048u, 2'049u, 5'000u, 1'000'000u, 3'000u}) {
    for (const std::size_t insertions : {0u, 1u, 33u, 34u, 2'000u, 40'000u}) {
      set.Clear(triangles);
      std::set<PrimitiveId> want;
      for (std::size_t i = 0; i < insertions; ++i) {
        // Half of them multiples of a power of two, which a poor hash would put in one place.
        const auto id = static_cast<PrimitiveId>(
            i % 2 == 0 ? engine() % triangles : (engine() % (triangles / 64 + 1) * 64) % triangles);
        ASSERT_EQ(set.Contains(id), want.count(id) != 0);
        ASSERT_EQ(set.Insert(id), want.insert(id).second) << triangles << ", " << insertions;
      }
      for (const PrimitiveId id : want) ASSERT_TRUE(set.Contains(id));
    }
  }
}

/// Adds hits and keeps the nearest whenever the list is full, as a search does.
NearestHits Collect(const std::vector<Hit>& offered, std::size_t max_hits, std::size_t* largest) {
  CancelPoll never{CancelToken()};
  NearestHits nearest;
  nearest.Begin(max_hits);
  double limit = std::numeric_limits<double>::infinity();
  for (const Hit& hit : offered) {
    if (hit.t > limit) continue;
    nearest.Add(hit);
    *largest = std::max(*largest, nearest.hits().size());
    if (nearest.IsFull()) limit = nearest.KeepNearest(&never);
  }
  nearest.KeepNearest(&never);
  return nearest;
}

TEST(NearestHits, AreTheNearestOfAnyNumberAndRepeatsTakeNoPlace) {
  auto engine = test::RandomEngine(2301);
  for (const std::size_t offers : {0u, 1u, 63u, 64u, 65u, 300u, 20'000u}) {
    for (const std::size_t max_hits :
         {std::size_t{0}, std::size_t{1}, std::size_t{3}, std::size_t{64}, std::size_t{1'000},
          std::numeric_limits<std::size_t>::max()}) {
      std::vector<Hit> offered;
      for (std::size_t i = 0; i < offers; ++i) {
        // Each triangle has one t, and many have the same.
        const auto id = static_cast<PrimitiveId>(engine() % (offers / 3 + 1));
        offered.push_back({static_cast<double>(id * 7919u % 97u), 0, 0, id});
      }
      std::size_t largest = 0;
      NearestHits nearest = Collect(offered, max_hits, &largest);
      std::vector<Hit> want = offered;
      std::sort(want.begin(), want.end(), [](const Hit& a, const Hit& b) {
        return Closer(a.t, a.primitive_id, b.t, b.primitive_id);
      });
      want.erase(std::unique(want.begin(), want.end()), want.end());
      const bool cut = want.size() > max_hits;
      want.resize(std::min(max_hits, want.size()));
      const std::vector<Hit> got(nearest.hits().begin(), nearest.hits().end());
      ASSERT_EQ(got, want) << offers << " offers, " << max_hits << " kept";
      EXPECT_EQ(nearest.is_truncated(), cut) << offers << " offers, " << max_hits << " kept";
      if (max_hits <= 1'000) {
        EXPECT_LE(largest, std::max<std::size_t>(64, 2 * max_hits));
      }
    }
  }
}

TEST(NearestHits, OfEqualTAreInTheGivenOrder) {
  CancelPoll never{CancelToken()};
  NearestHits nearest;
  nearest.Begin(3);
  for (const PrimitiveId id : {4u, 2u, 4u, 9u}) nearest.Add({1, 0, 0, id});
  nearest.Add({1, 0, 0, 2});  // again, from another leaf
  nearest.Add({0.5, 0, 0, 5});
  const double limit = nearest.KeepNearest(
      [](std::span<Hit> ties) { std::reverse(ties.begin(), ties.end()); }, &never);
  std::vector<PrimitiveId> order;
  for (const Hit& hit : nearest.hits()) order.push_back(hit.primitive_id);
  EXPECT_EQ(order, (std::vector<PrimitiveId>{5, 9, 4}));
  EXPECT_EQ(limit, 1);
  EXPECT_TRUE(nearest.is_truncated());
}

TEST(HitPieces, KeepTheHitsOfEveryRowWhereTheyAre) {
  HitPieces pieces;
  std::atomic<std::size_t> total{0};
  constexpr std::size_t kRows = 3'000, kThreads = 3;
  std::vector<HitRow> rows(kThreads * kRows);
  const auto size_of = [](std::size_t row) { return row % 1'000 == 7 ? 70'000 : row % 90; };
  std::vector<std::thread> threads;
  for (std::size_t thread = 0; thread < kThreads; ++thread) {
    threads.emplace_back([&, thread] {
      for (std::size_t first = 0; first < kRows; first += 100) {
        HitPieces::Rest rest = pieces.Take();
        const HitLists lists = {100'000, rows.data(), &pieces, &rest, &total};
        for (std::size_t i = first; i < first + 100; ++i) {
          const std::size_t row = i * kThreads + thread;
          const std::span<Hit> hits = NearestHits::Append(row, size_of(row), row % 2 == 0, lists);
          for (std::size_t k = 0; k < hits.size(); ++k) {
            hits[k] = {static_cast<double>(row), 0, 0, static_cast<PrimitiveId>(k)};
          }
        }
        pieces.GiveBack(rest);
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  std::size_t sum = 0;
  for (std::size_t row = 0; row < rows.size(); ++row) {
    ASSERT_EQ(rows[row].size, size_of(row));
    ASSERT_EQ(rows[row].is_truncated, row % 2 == 0);
    sum += rows[row].size;
    for (std::size_t k = 0; k < rows[row].size; ++k) {
      ASSERT_EQ(rows[row].hits[k],
                (Hit{static_cast<double>(row), 0, 0, static_cast<PrimitiveId>(k)}));
    }
  }
  EXPECT_LE(total, sum);
  EXPECT_GT(total + 1'024 * kThreads, sum);
}

}  // namespace
}  // namespace kdray::core
