// SPDX-License-Identifier: Apache-2.0
// The arithmetic is what it says, whatever the compiler makes of it.
#include "core/geometry/vec3.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

#include "core/geometry/bounds3.h"

namespace kdray::core {
namespace {

// Volatile, so that the compiler cannot drop this conversion as well.
bool IsRounded(double value, double from) {
  volatile float rounded = static_cast<float>(from);
  return value == static_cast<double>(rounded);
}

// Out of line, so that the compiler sees code like that of the mesh and the trees.
[[gnu::noinline]] Vec3d Round(const Vec3d& p) { return Vec3d(Vec3f(p)); }
[[gnu::noinline]] void RoundAll(std::vector<Vec3d>* points) {
  for (Vec3d& p : *points) p = Vec3d(Vec3f(p));
}
[[gnu::noinline]] void RoundAll(std::vector<double>* values) {
  for (double& value : *values) value = static_cast<double>(static_cast<float>(value));
}

// g++ 12 optimises the conversion to float and back away when it puts two of them into one vector;
// the build switches that optimisation off (cmake/KdrayTarget.cmake).
TEST(Vec3, ConvertedToFloatAndBackHasFloatsNumbers) {
  std::vector<Vec3d> exact;
  for (int i = 0; i < 100; ++i)
    exact.push_back({0.1 + i * 0.0123, 0.2 + i * 0.0123, 0.7 * i + 0.3});
  std::vector<Vec3d> rounded = exact;
  RoundAll(&rounded);
  for (std::size_t i = 0; i < exact.size(); ++i) {
    for (int axis = 0; axis < 3; ++axis) {
      ASSERT_TRUE(IsRounded(rounded[i][axis], exact[i][axis])) << i << ", axis " << axis;
    }
  }
  EXPECT_EQ(Round(exact[7]), rounded[7]);
  EXPECT_EQ(Round(rounded[7]), rounded[7]);
}

TEST(Vec3, ArraysConvertedToFloatAndBackHaveFloatsNumbers) {
  std::vector<double> exact(1000);
  for (std::size_t i = 0; i < exact.size(); ++i) exact[i] = 0.1 + static_cast<double>(i) * 0.0123;
  std::vector<double> rounded = exact;
  RoundAll(&rounded);
  for (std::size_t i = 0; i < exact.size(); ++i) ASSERT_TRUE(IsRounded(rounded[i], exact[i])) << i;
}

TEST(RoundUp, GivesTheNeighbouringFloatsOnBothSides) {
  constexpr float kInf = std::numeric_limits<float>::infinity();
  for (const float x : {0.0f, -0.0f, 1.0f, -1.0f, 0x1p-149f, -0x1p-149f, 0x1p-126f, -0x1p-126f,
                        0x1.fffffep127f, -0x1.fffffep127f, 0x1.fffffep-1f}) {
    const double exact = static_cast<double>(x);
    EXPECT_EQ(RoundUp(exact), x);
    EXPECT_EQ(RoundDown(exact), x);
    // A little more or less than a float, which rounds to it.
    const double above = std::nextafter(exact, 1e300);
    const double below = std::nextafter(exact, -1e300);
    EXPECT_EQ(RoundUp(above), std::nextafter(x, kInf)) << x;
    EXPECT_EQ(RoundDown(above), x) << x;
    EXPECT_EQ(RoundDown(below), std::nextafter(x, -kInf)) << x;
    EXPECT_EQ(RoundUp(below), x) << x;
  }
  EXPECT_EQ(RoundUp(1e39), kInf);
  EXPECT_EQ(RoundDown(1e39), 0x1.fffffep127f);
  EXPECT_EQ(RoundUp(-1e39), -0x1.fffffep127f);
  EXPECT_EQ(RoundDown(-1e39), -kInf);
}

}  // namespace
}  // namespace kdray::core
