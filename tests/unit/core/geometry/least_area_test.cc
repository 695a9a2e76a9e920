// SPDX-License-Identifier: Apache-2.0
#include "core/geometry/least_area.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include "tests/support/seed.h"

namespace kdray::core {
namespace {

double DoubleArea(Point2 a, Point2 b, Point2 c) {
  return std::fabs((b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x));
}

// By trying all triangles at the edge from the last corner to the first, again and again.
double LeastByTrial(const std::vector<Point2>& path, std::size_t i, std::size_t j) {
  if (j - i < 2) return 0;
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t k = i + 1; k < j; ++k) {
    least = std::min(least, DoubleArea(path[i], path[k], path[j]) + LeastByTrial(path, i, k) +
                                LeastByTrial(path, k, j));
  }
  return least;
}

TEST(LeastArea, IsTheLeastOfAllWaysToCutThePath) {
  std::mt19937_64 random = test::RandomEngine(46);
  for (int round = 0; round < 200; ++round) {
    const std::size_t n = 3 + static_cast<std::size_t>(round) % 7;
    std::vector<Point2> path;
    for (std::size_t i = 0; i < n; ++i) {
      path.push_back({static_cast<double>(random() % 9), static_cast<double>(random() % 9)});
    }
    CutMeter meter({});
    meter.Allow(1000000);
    std::vector<std::array<std::uint32_t, 3>> triangles;
    CutWithLeastArea(path, &meter, &triangles);
    ASSERT_EQ(triangles.size(), n - 2);
    double sum = 0;
    for (const auto& [a, b, c] : triangles) {
      ASSERT_LT(a, b);
      ASSERT_LT(b, c);
      sum += DoubleArea(path[a], path[b], path[c]);
    }
    EXPECT_EQ(sum, LeastByTrial(path, 0, n - 1));
  }
}

}  // namespace
}  // namespace kdray::core
