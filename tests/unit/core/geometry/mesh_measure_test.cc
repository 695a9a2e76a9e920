// SPDX-License-Identifier: Apache-2.0
#include "core/geometry/mesh_measure.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "tests/support/shapes.h"

namespace kdray::core {
namespace {

MeshMeasure Measure(const MeshData& data) {
  const Result<TriangleMesh> mesh = TriangleMesh::Create(data);
  EXPECT_TRUE(mesh.ok());
  return *MeasureMesh(*mesh);
}

// A box from `min` with these sides, turned outward.
MeshData Box(const Vec3d& min, const Vec3d& sides) {
  MeshData data;
  for (int i = 0; i < 8; ++i) {
    data.vertices.push_back(
        {min.x + (i % 2) * sides.x, min.y + (i / 2 % 2) * sides.y, min.z + (i / 4) * sides.z});
  }
  data.triangles = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4},
                    {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
  return data;
}

TEST(MeshMeasure, OfABoxIsThatOfItsSidesWhereverItIs) {
  for (const double far : {0.0, 1e9, -1048576.0}) {
    const MeshMeasure box = Measure(Box({far, far / 2, 5}, {2, 3, 4}));
    EXPECT_EQ(box.area, 52) << far;
    EXPECT_EQ(box.volume, 24) << far;
  }
}

TEST(MeshMeasure, OfAnInsideOutMeshIsNegative) {
  MeshData data = Box({1, 2, 3}, {1, 1, 1});
  for (TriangleIndices& triangle : data.triangles) std::swap(triangle[1], triangle[2]);
  EXPECT_EQ(Measure(data).volume, -1);
  EXPECT_EQ(Measure(data).area, 6);
}

TEST(MeshMeasure, ScalesWithoutRoundingByPowersOfTwo) {
  const MeshMeasure unit = Measure(test::UvSphere({0, 0, 0}, 1, 20, 40));
  EXPECT_NEAR(unit.area, 4 * std::numbers::pi, 0.2);
  EXPECT_NEAR(unit.volume, 4 * std::numbers::pi / 3, 0.1);
  for (const int exponent : {-100, 100}) {
    MeshData data = test::UvSphere({0, 0, 0}, 1, 20, 40);
    for (Vec3d& p : data.vertices) p = p * std::ldexp(1.0, exponent);
    EXPECT_EQ(Measure(data).area, std::ldexp(unit.area, 2 * exponent));
    EXPECT_EQ(Measure(data).volume, std::ldexp(unit.volume, 3 * exponent));
  }
}

TEST(MeshMeasure, LosesNoDigitsInManySmallTriangles) {
  // A sheet of 500,000 triangles whose areas add up to 1.
  MeshData data;
  const int n = 500;
  for (int i = 0; i <= n; ++i) {
    for (int j = 0; j <= n; ++j) {
      data.vertices.push_back({static_cast<double>(i) / n, static_cast<double>(j) / n, 0});
    }
  }
  for (std::uint32_t i = 0; i < n; ++i) {
    for (std::uint32_t j = 0; j < n; ++j) {
      const std::uint32_t a = i * (n + 1) + j;
      data.triangles.push_back({a, a + n + 1, a + 1});
      data.triangles.push_back({a + 1, a + n + 1, a + n + 2});
    }
  }
  EXPECT_NEAR(Measure(data).area, 1, 4e-15);
}

TEST(MeshMeasure, StopsWhenAsked) {
  const Result<TriangleMesh> mesh = TriangleMesh::Create(test::UvSphere({0, 0, 0}, 1, 20, 40));
  ASSERT_TRUE(mesh.ok());
  const CancelToken cancelled = CancelToken::Cancellable();
  cancelled.Cancel();
  const auto measure = MeasureMesh(*mesh, cancelled);
  ASSERT_FALSE(measure.ok());
  EXPECT_EQ(measure.error().code, ErrorCode::kCancelled);
}

}  // namespace
}  // namespace kdray::core
