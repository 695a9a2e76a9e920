#include "clients/cpp/sample/sample_rays.h"

#include <gtest/gtest.h>

#include <cmath>

namespace kdray::client {
namespace {

const Box kBox = {{-1, 2, -3}, {1, 4, 5}};

TEST(SampleRays, StartOutsideTheBoxAndPassThroughItAtOne) {
  const auto rays = RaysTowardsBox(kBox, 1000, 1);
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
  const auto rays = RaysTowardsBox(kBox, 8000, 1);
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
  EXPECT_EQ(RaysTowardsBox(kBox, 10, 7), RaysTowardsBox(kBox, 10, 7));
  EXPECT_NE(RaysTowardsBox(kBox, 10, 7), RaysTowardsBox(kBox, 10, 8));
}

TEST(SampleRays, AimAtAPointToo) {
  const auto rays = RaysTowardsBox({{1, 1, 1}, {1, 1, 1}}, 5, 1);
  for (const float x : rays) EXPECT_TRUE(std::isfinite(x));
}

}  // namespace
}  // namespace kdray::client
