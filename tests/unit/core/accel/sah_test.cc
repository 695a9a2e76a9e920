// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include "core/accel/kdtree/split.h"
#include "core/accel/sah_cost.h"

namespace kdray::test {
namespace {

using core::Bounds3f;
using core::SahCost;
using core::SplitCandidate;
using core::SplitProbability;
using core::SplitSearch;

TEST(SahCost, OfALeafGrowsWithItsBlocks) {
  const SahCost cost{1, 1.5, 0.8};
  EXPECT_EQ(cost.Leaf(0), 0);
  EXPECT_EQ(cost.Leaf(1), 1.5);
  EXPECT_EQ(cost.Leaf(8), 1.5);
  EXPECT_EQ(cost.Leaf(9), 3);
  EXPECT_EQ(cost.Leaf(80), 15);
}

TEST(SahCost, OfWhatMayBeSplitFurtherHasNoSteps) {
  const SahCost cost{1, 4, 0.8};
  for (std::size_t n = 0; n <= 16; ++n) EXPECT_EQ(cost.Subtree(n), cost.Leaf(n));
  for (std::size_t n = 17; n <= 100; ++n) {
    EXPECT_EQ(cost.Subtree(n), cost.Subtree(17) + 0.5 * static_cast<double>(n - 17));
    EXPECT_GE(cost.Subtree(n), cost.Leaf(n));
  }
  EXPECT_EQ(cost.Subtree(25), cost.Leaf(25));
}

TEST(SahCost, ChargesLessForTheBlocksOfLargeMeshes) {
  EXPECT_EQ(SahCost::For(200'000).intersection, 4);
  EXPECT_EQ(SahCost::For(200'001).intersection, 2);
}

TEST(SahCost, OfASplitWeighsTheChildrenByProbability) {
  const SahCost cost{1, 2, 0.5};
  EXPECT_EQ(cost.Split(0.5, 8, 0.75, 16), 1 + 0.5 * 2 + 0.75 * 4);
}

TEST(SahCost, RewardsCuttingOffEmptySpace) {
  const SahCost cost{1, 2, 0.5};
  EXPECT_EQ(cost.Split(0.5, 0, 0.75, 16), 0.5 * (1 + 0.75 * 4));
  EXPECT_EQ(cost.Split(0.5, 16, 0.75, 0), 0.5 * (1 + 0.5 * 4));
}

TEST(SplitProbability, IsTheRatioOfSurfaceAreas) {
  const Bounds3f cell{{0, 0, 0}, {4, 2, 1}};  // area 2 * (8 + 2 + 4) = 28
  const SplitProbability across_x(cell, 0);
  EXPECT_DOUBLE_EQ(across_x.Below(1), 2 * (2 + 2 + 1) / 28.0);  // 1 x 2 x 1
  EXPECT_DOUBLE_EQ(across_x.Above(1), 2 * (6 + 2 + 3) / 28.0);  // 3 x 2 x 1
  const SplitProbability across_z(cell, 2);
  EXPECT_DOUBLE_EQ(across_z.Below(0.25f), 2 * (8 + 0.5 + 1) / 28.0);
}

TEST(SplitProbability, HoldsForFlatAndForTinyCells) {
  const SplitProbability flat(Bounds3f{{0, 0, 0}, {2, 2, 0}}, 0);
  ASSERT_TRUE(flat.IsValid());
  EXPECT_DOUBLE_EQ(flat.Below(0.5f), 0.25);
  EXPECT_DOUBLE_EQ(flat.Above(0.5f), 0.75);

  const float s = 0x1p-126f;
  const SplitProbability tiny(Bounds3f{{0, 0, 0}, {s, s, s}}, 1);
  ASSERT_TRUE(tiny.IsValid());
  EXPECT_DOUBLE_EQ(tiny.Below(s / 2), 2.0 / 3);

  EXPECT_FALSE(SplitProbability(Bounds3f{{0, 0, 0}, {1, 0, 0}}, 0).IsValid());
}

TEST(SplitSearch, FindsNothingThatCostsAsMuchAsALeaf) {
  const SahCost cost{1, 1, 1};
  const Bounds3f cell{{0, 0, 0}, {1, 1, 1}};
  SplitSearch search(cost, cell, 32);
  SplitSearch::Axis axis(&search, 0);
  axis.Consider(0.5f, 25, 0, 25);  // 1 + 2/3 * 8 > 39 / 8
  EXPECT_FALSE(search.best());
}

TEST(SplitSearch, KeepsTheCheapestAndTheFirstOfEquals) {
  const SahCost cost{1, 1, 1};
  const Bounds3f cell{{0, 0, 0}, {1, 1, 1}};
  SplitSearch search(cost, cell, 100);
  for (int a : {0, 1}) {
    SplitSearch::Axis axis(&search, a);
    axis.Consider(0.25f, 25, 0, 75);
    axis.Consider(0.5f, 40, 0, 40);
    axis.Consider(0.75f, 75, 0, 25);
  }
  ASSERT_TRUE(search.best());
  EXPECT_EQ(search.best()->plane, (core::SplitPlane{0, 0.5f}));
  EXPECT_EQ(search.best()->below, 40u);
  EXPECT_EQ(search.best()->above, 40u);
  EXPECT_DOUBLE_EQ(search.best()->cost, 1 + 2.0 / 3 * 2 * 47 / 8);
}

TEST(SplitSearch, PutsPlanarTrianglesOnTheCheaperSide) {
  const SahCost cost{1, 1, 1};
  const Bounds3f cell{{0, 0, 0}, {1, 1, 1}};
  for (const bool below : {true, false}) {
    SplitSearch search(cost, cell, 100);
    SplitSearch::Axis axis(&search, 0);
    axis.Consider(below ? 0.25f : 0.75f, 10, 30, 10);
    ASSERT_TRUE(search.best());
    EXPECT_EQ(search.best()->planar_below, below);
    EXPECT_EQ(search.best()->below, below ? 40u : 10u);
    EXPECT_EQ(search.best()->above, below ? 10u : 40u);
  }
}

TEST(SplitSearch, PassesOverPlanesThatAreNotStrictlyInside) {
  const SahCost cost{1, 1, 0.1};
  const Bounds3f cell{{0, 0, 0}, {1, 1, 1}};
  SplitSearch search(cost, cell, 100);
  SplitSearch::Axis axis(&search, 2);
  axis.Consider(0, 0, 0, 100);
  axis.Consider(1, 100, 0, 0);
  axis.Consider(-1, 0, 0, 100);
  EXPECT_FALSE(search.best());
}

}  // namespace
}  // namespace kdray::test
