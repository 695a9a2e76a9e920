// SPDX-License-Identifier: Apache-2.0
#include "core/geometry/index_set.h"

#include <gtest/gtest.h>

#include <random>
#include <set>

#include "tests/support/seed.h"

namespace kdray::core {
namespace {

TEST(IndexSet, FindsTheNextMemberAroundTheEndAsAnOrderedSetDoes) {
  std::mt19937_64 random = test::RandomEngine(45);
  IndexSet set;
  for (const std::uint32_t size : {1u, 5u, 64u, 65u, 4096u, 4097u, 300000u}) {
    set.Reset(size);
    EXPECT_EQ(set.NextFrom(0), std::nullopt);
    std::set<std::uint32_t> oracle;
    for (int round = 0; round < 5000; ++round) {
      const auto i = static_cast<std::uint32_t>(random() % size);
      if (random() % 3 == 0) {
        set.Insert(i);
        oracle.insert(i);
      } else {
        const std::uint32_t member = oracle.empty() ? i : *oracle.begin();
        set.Erase(member);
        oracle.erase(member);
      }
      const auto start = static_cast<std::uint32_t>(random() % size);
      auto next = oracle.lower_bound(start);
      if (next == oracle.end()) next = oracle.begin();
      const std::optional<std::uint32_t> found = set.NextFrom(start);
      ASSERT_EQ(found.has_value(), !oracle.empty());
      if (found) {
        ASSERT_EQ(*found, *next);
      }
    }
  }
}

}  // namespace
}  // namespace kdray::core
