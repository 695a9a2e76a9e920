// SPDX-License-Identifier: Apache-2.0
#include "core/render/shading.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <set>
#include <tuple>

namespace kdray::core {
namespace {

TriangleMesh OneTriangle(const Vec3d& a, const Vec3d& b, const Vec3d& c) {
  MeshData data;
  data.vertices = {a, b, c};
  data.triangles = {{0, 1, 2}};
  return *TriangleMesh::Create(data);
}

TEST(Shading, NormalsFollowTheOrderOfTheCorners) {
  EXPECT_EQ(UnitNormal(OneTriangle({0, 0, 0}, {2, 0, 0}, {0, 3, 0}), 0), (Vec3d{0, 0, 1}));
  EXPECT_EQ(UnitNormal(OneTriangle({0, 0, 0}, {0, 3, 0}, {2, 0, 0}), 0), (Vec3d{0, 0, -1}));
  EXPECT_EQ(UnitNormal(OneTriangle({5, 1, 1}, {5, 2, 1}, {5, 1, 2}), 0), (Vec3d{1, 0, 0}));
}

TEST(Shading, NormalsDoNotDependOnScaleOrPlace) {
  const Vec3d a = {0.25, 0.5, 0.125};
  const Vec3d b = {1, 0.375, 0.5};
  const Vec3d c = {0.5, 1, -0.25};
  const Vec3d expected = UnitNormal(OneTriangle(a, b, c), 0);
  EXPECT_NEAR(Length(expected), 1, 1e-15);
  for (int exponent = -100; exponent <= 100; exponent += 10) {
    const double s = std::ldexp(1.0, exponent);
    EXPECT_EQ(UnitNormal(OneTriangle(a * s, b * s, c * s), 0), expected);
  }
  const Vec3d away = {1 << 20, -(1 << 21), 1 << 22};
  EXPECT_EQ(UnitNormal(OneTriangle(a + away, b + away, c + away), 0), expected);
}

TEST(Shading, NormalsOfSpecksBesideAGiantAreUnit) {
  MeshData data;
  data.vertices = {{1e30, 0, 0}, {0, 1e30, 0},  {0, 0, 1e30},
                   {0, 0, 0},    {1e-30, 0, 0}, {0, 1e-30, 0}};
  data.triangles = {{0, 1, 2}, {3, 4, 5}};
  EXPECT_EQ(UnitNormal(*TriangleMesh::Create(data), 1), (Vec3d{0, 0, 1}));
}

TEST(Shading, DegenerateTrianglesHaveAZeroNormal) {
  EXPECT_EQ(UnitNormal(OneTriangle({0, 0, 0}, {1, 1, 1}, {2, 2, 2}), 0), Vec3d{});
  EXPECT_EQ(UnitNormal(OneTriangle({1, 2, 3}, {1, 2, 3}, {1, 2, 3}), 0), Vec3d{});
}

TEST(Shading, AHeadlightFollowsLambertOnBothSides) {
  EXPECT_EQ(HeadlightCosine<double>({0, 0, 1}, {0, 0, -1}), 1.0f);
  EXPECT_EQ(HeadlightCosine<double>({0, 0, 1}, {0, 0, 1}), 1.0f);
  EXPECT_EQ(HeadlightCosine<double>({0, 0, 1}, {1, 0, 0}), 0.0f);
  EXPECT_NEAR(HeadlightCosine<double>({0, 0, 1}, {0, 3, 3}), std::sqrt(0.5), 1e-7);
  EXPECT_EQ(HeadlightCosine<double>({}, {0, 3, 3}), 1.0f);
}

TEST(Shading, ColoursOfTrianglesAreValidAndNearNumbersDiffer) {
  std::set<std::tuple<int, int, int>> seen;
  Rgb last = HashedColor(kNoPrimitive);
  for (PrimitiveId id = 0; id < 1000; ++id) {
    const Rgb c = HashedColor(id);
    for (const float channel : {c.r, c.g, c.b}) {
      ASSERT_GE(channel, 0.0f);
      ASSERT_LE(channel, 1.0f);
    }
    ASSERT_NE(c, last);
    last = c;
    seen.emplace(ToUnorm8(c.r), ToUnorm8(c.g), ToUnorm8(c.b));
  }
  EXPECT_GT(seen.size(), 990u);
}

}  // namespace
}  // namespace kdray::core
