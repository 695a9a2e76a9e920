// SPDX-License-Identifier: Apache-2.0
#include "clients/cpp/sample/sample_rays.h"

#include <gtest/gtest.h>

#include <cmath>

namespace kdray::client {
namespace {

const Box kBox = {{-1, 2, -3}, {1, 4, 5}};

TEST(SampleRays, StartOutsideTheBoxAndPassThroughItAtOne) {
  const auto rays = RaysTowardsBox(kBox, 1).Next(1000);
  ASSERT_EQ(rays.size(), 6000u);
  for (std::size_t i = 0; i < rays.size(); i += 6) {
    bool outside = false;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const double origin = static_cast<double>(rays[i + axis]);
      const double target = origin + static_cast<double>(rays[i + 3 + axis]);
      outside |= origin < kBox.min[axis] || origin > kBox.max[axis];
      EXPECT_GE(target, kBox.min[axis] - 1e-5);
      EXPECT_LE(target, kBox.max[axis] + 1e-5);
    }
    EXPECT_TRUE(outside);
  }
}

TEST(SampleRays, ComeFromAllAround) {
  int octants[8] = {};
  const auto rays = RaysTowardsBox(kBox, 1).Next(8000);
  const double center[3] = {0, 3, 1};
  for (std::size_t i = 0; i < rays.size(); i += 6) {
    int octant = 0;
    for (std::size_t axis = 0; axis < 3; ++axis)
      octant |= (static_cast<double>(rays[i + axis]) > center[axis] ? 1 : 0) << axis;
    ++octants[octant];
  }
  for (const int count : octants) EXPECT_NEAR(count, 1000, 150);  // five standard deviations
}

TEST(SampleRays, AreTheSameForTheSameSeedOnly) {
  EXPECT_EQ(RaysTowardsBox(kBox, 7).Next(10), RaysTowardsBox(kBox, 7).Next(10));
  EXPECT_NE(RaysTowardsBox(kBox, 7).Next(10), RaysTowardsBox(kBox, 8).Next(10));
}

TEST(SampleRays, AreTheSameHoweverTheyAreDivided) {
  RaysTowardsBox parts(kBox, 7);
  std::vector<float> rays = parts.Next(3);
  const std::vector<float> rest = parts.Next(7);
  rays.insert(rays.end(), rest.begin(), rest.end());
  EXPECT_EQ(rays, RaysTowardsBox(kBox, 7).Next(10));
}

TEST(SampleRays, AimAtAPointToo) {
  const auto rays = RaysTowardsBox({{1, 1, 1}, {1, 1, 1}}, 1).Next(5);
  for (const float x : rays) EXPECT_TRUE(std::isfinite(x));
}

}  // namespace
}  // namespace kdray::client
