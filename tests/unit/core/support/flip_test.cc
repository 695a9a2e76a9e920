// SPDX-License-Identifier: Apache-2.0
// The measure that compares pictures, checked against its paper's statements.
#include "tests/support/flip.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

namespace kdray::test {
namespace {

LinearImage Plain(float r, float g, float b) {
  LinearImage image{40, 30, {}};
  for (int i = 0; i < 40 * 30; ++i) image.rgb.insert(image.rgb.end(), {r, g, b});
  return image;
}

/// White to the left of column `edge`, black from there on.
LinearImage Edge(int edge) {
  LinearImage image{40, 30, {}};
  for (int i = 0; i < 40 * 30; ++i) image.rgb.insert(image.rgb.end(), 3, i % 40 < edge ? 1.f : 0.f);
  return image;
}

TEST(Flip, OfAnImageAndItselfIsZero) {
  for (const float f : Flip(Edge(17), Edge(17))) EXPECT_EQ(f, 0);
}

TEST(Flip, IsOneForTheTwoColoursThatAreFarthestApart) {
  for (const float f : Flip(Plain(0, 1, 0), Plain(0, 0, 1))) EXPECT_NEAR(f, 1, 1e-5);
}

TEST(Flip, OfBlackAndWhiteFollowsFromTheConstants) {
  // HyAB is 100, to the power 0.7; the farthest colours are 203.2 apart; plain images have no
  // features: 0.95 + 0.05 * (25.12 - 0.4 * 41.2) / (0.6 * 41.2).
  EXPECT_NEAR(MeanFlip(Plain(0, 0, 0), Plain(1, 1, 1)), 0.9675, 2e-4);
}

TEST(Flip, IsSymmetricAndWithinZeroAndOne) {
  const LinearImage a = Edge(15), b = Plain(0.2f, 0.5f, 0.1f);
  const std::vector<float> ab = Flip(a, b), ba = Flip(b, a);
  EXPECT_EQ(ab, ba);
  EXPECT_GE(*std::min_element(ab.begin(), ab.end()), 0);
  EXPECT_LE(*std::max_element(ab.begin(), ab.end()), 1);
}

TEST(Flip, GrowsWithTheDifference) {
  double previous = 0;
  for (const float grey : {0.5f, 0.45f, 0.3f, 0.1f, 0.0f}) {
    const double flip = MeanFlip(Plain(0.5f, 0.5f, 0.5f), Plain(grey, grey, grey));
    EXPECT_GE(flip, previous);
    previous = flip;
  }
  EXPECT_GT(previous, 0.5);
}

TEST(Flip, OfAMovedEdgeIsLargestAtTheEdge) {
  const std::vector<float> flip = Flip(Edge(20), Edge(22));
  const auto row = flip.begin() + 15 * 40;
  const auto largest = std::max_element(row, row + 40) - row;
  EXPECT_GE(largest, 18);
  EXPECT_LE(largest, 24);
  EXPECT_LT(flip[15 * 40 + 2], 0.05f * flip[static_cast<std::size_t>(15 * 40 + largest)]);
}

TEST(Flip, MakesADifferenceAtAFeatureWeighMoreThanItsColourAlone) {
  // Seen from far away the eye blurs the moved line; the feature still counts.
  EXPECT_GT(MeanFlip(Edge(20), Edge(21)), 0.01);
  EXPECT_LT(MeanFlip(Edge(20), Edge(21)), MeanFlip(Edge(20), Edge(26)));
}

}  // namespace
}  // namespace kdray::test
