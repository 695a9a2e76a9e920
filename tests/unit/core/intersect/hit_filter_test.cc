// SPDX-License-Identifier: Apache-2.0
#include "core/intersect/hit_filter.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "tests/support/rationals.h"
#include "tests/support/seed.h"
#include "tests/support/shapes.h"

namespace kdray::core {
namespace {

using Q3 = std::array<mpq_class, 3>;
Q3 ToQ(const Vec3d& v) { return {mpq_class(v.x), mpq_class(v.y), mpq_class(v.z)}; }
Q3 Minus(const Q3& a, const Q3& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
mpq_class DotOf(const Q3& a, const Q3& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
Q3 NormalOf(const test::TriangleCorners& corners) {
  const Q3 a = ToQ(corners[0]);
  const Q3 b = Minus(ToQ(corners[1]), a), c = Minus(ToQ(corners[2]), a);
  return {b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0]};
}

int RationalSide(const test::TriangleCorners& corners, const Ray& ray) {
  return sgn(DotOf(NormalOf(corners), ToQ(ray.direction))) < 0 ? 1 : -1;
}
bool RationalWithin(const test::TriangleCorners& corners, const Q3& point, double offset) {
  const Q3 normal = NormalOf(corners);
  const mpq_class volume = DotOf(normal, Minus(point, ToQ(corners[0])));
  return volume * volume <= mpq_class(offset) * mpq_class(offset) * DotOf(normal, normal);
}

std::vector<MeshData> Meshes() {
  return {test::Cube({0.5, 0.5, 0.5}, 0.5), test::Soup(40, 0.5, 8),
          test::UvSphere({448'251.25, 5'411'932.5, 122.75}, 10, 5, 7),
          test::UvSphere({1e-12, 0, 3e-12}, 1e-11, 5, 7), test::Soup(20, 1e-6, 9)};
}

/// Rays that begin and end on the mesh, in its planes, and a little beside them.
Ray NearRay(const MeshData& data, double offset, std::mt19937_64& engine) {
  const auto point = [&] {
    const TriangleIndices& t = data.triangles[engine() % data.triangles.size()];
    const Vec3d a = data.vertices[t[0]], b = data.vertices[t[1]], c = data.vertices[t[2]];
    const double u = static_cast<double>(engine() % 9) / 4 - 1,
                 v = static_cast<double>(engine() % 9) / 4 - 1;
    Vec3d at = a * (1 - u - v) + b * u + c * v;
    if (engine() % 2 == 0) {
      const double away = offset * (1 + static_cast<double>(static_cast<int>(engine() % 5) - 2) *
                                            0x1p-52 * static_cast<double>(engine() % 3));
      at = at + NormalizedAtAnyScale(Cross(b - a, c - a)) * away;
    }
    return at;
  };
  Ray ray;
  ray.origin = point();
  ray.direction = point() - ray.origin;
  if (engine() % 4 == 0) ray.direction = ray.direction * 0x1p-600;
  if (engine() % 8 == 0) {
    ray.direction = {};
    ray.direction[static_cast<int>(engine() % 3)] = 0x1p300;
  }
  return ray;
}

TEST(HitFilter, DecidesSidesAndDistancesAsRationalNumbersDo) {
  auto engine = test::RandomEngine(2400);
  for (const MeshData& data : Meshes()) {
    const TriangleMesh mesh = TriangleMesh::Create(data).value();
    int within = 0, fronts = 0, all = 0;
    for (const Precision precision : {Precision::kFast, Precision::kDouble, Precision::kExact}) {
      const double offset = SurfaceOffset(mesh, precision, precision == Precision::kFast);
      const HitFilter back(mesh, {.cull = Cull::kBack}), front(mesh, {.cull = Cull::kFront});
      const HitFilter start(mesh, {.starts_on_surface = true, .surface_offset = offset});
      const HitFilter end(mesh, {.ends_on_surface = true, .surface_offset = offset});
      for (int i = 0; i < 300; ++i) {
        const Ray ray = NearRay(data, offset, engine);
        if (!IsValid(ray)) continue;
        const auto id = static_cast<PrimitiveId>(engine() % data.triangles.size());
        const test::TriangleCorners corners = test::CornersOf(data, id);
        const int side = RationalSide(corners, ray);
        ASSERT_EQ(SideMet(mesh, ray, id), side);
        ASSERT_EQ(back.Keeps(ray, id), side > 0);
        ASSERT_EQ(front.Keeps(ray, id), side < 0);
        const Q3 origin = ToQ(ray.origin), direction = ToQ(ray.direction);
        const bool starts = RationalWithin(corners, origin, offset);
        ASSERT_EQ(start.Keeps(ray, id), !starts);
        const Q3 last{origin[0] + direction[0], origin[1] + direction[1], origin[2] + direction[2]};
        ASSERT_EQ(end.Keeps(ray, id), !RationalWithin(corners, last, offset));
        within += starts ? 1 : 0;
        fronts += side > 0 ? 1 : 0;
        ++all;
      }
    }
    EXPECT_GT(fronts, all / 5);
    EXPECT_GT(within, 0);
    EXPECT_LT(within, all);
  }
}

TEST(HitFilter, DecidesSidesOfDirectionsAtTheEndsOfTheRange) {
  auto engine = test::RandomEngine(2401);
  const MeshData data = test::Soup(40, 0.5, 8);
  const TriangleMesh mesh = TriangleMesh::Create(data).value();
  for (const double scale : {0x1p-1074, 0x1p-1070, 0x1p-1021, 0x1p1000, 0x1p1022}) {
    for (int i = 0; i < 60; ++i) {
      const auto part = [&] {
        return static_cast<double>(static_cast<int>(engine() % 31) - 15) / 8;
      };
      Ray ray;
      ray.direction = Vec3d{part(), part(), part()} * scale;
      if (!IsValid(ray)) continue;
      const auto id = static_cast<PrimitiveId>(engine() % data.triangles.size());
      ASSERT_EQ(SideMet(mesh, ray, id), RationalSide(test::CornersOf(data, id), ray)) << scale;
    }
  }
}

TEST(HitFilter, KeepsEverythingUnlessSomethingIsAsked) {
  const TriangleMesh mesh = TriangleMesh::Create(test::Cube({0, 0, 0}, 1)).value();
  EXPECT_FALSE(HitFilter(mesh, {}).is_active());
  EXPECT_TRUE(HitFilter(mesh, {.cull = Cull::kFront}).is_active());
  EXPECT_TRUE(HitFilter(mesh, {.starts_on_surface = true}).is_active());
  EXPECT_TRUE(HitFilter(mesh, {.ends_on_surface = true}).is_active());
}

TEST(SurfaceOffset, IsThatOfTheContract) {
  // Largest local coordinate 0.75 * 2^1, largest coordinate of the bounds 1.5.
  MeshData data = test::Cube({0.5, 0, 0}, 1);
  const TriangleMesh mesh = TriangleMesh::Create(data).value();
  for (const Precision precision : {Precision::kFast, Precision::kWatertight}) {
    EXPECT_EQ(SurfaceOffset(mesh, precision, true), 1.5 * (0x1p-20 + 0x1p-21));
    EXPECT_EQ(SurfaceOffset(mesh, precision, false), 1.5 * (0x1p-20 + 0x1p-49));
  }
  EXPECT_EQ(SurfaceOffset(mesh, Precision::kDouble, true), 1.5 * (0x1p-44 + 0x1p-21));
  EXPECT_EQ(SurfaceOffset(mesh, Precision::kDouble, false), 1.5 * (0x1p-44 + 0x1p-49));
  EXPECT_EQ(SurfaceOffset(mesh, Precision::kExact, false), 1.5 * 0x1p-49);
  // Far from the origin, the mesh's own size counts for its local coordinates only.
  const TriangleMesh far = TriangleMesh::Create(test::Cube({1 << 20, 0, 0}, 1)).value();
  const double largest = (1 << 20) + 1.0;
  EXPECT_EQ(SurfaceOffset(far, Precision::kExact, false), largest * 0x1p-49);
  EXPECT_LE(SurfaceOffset(far, Precision::kDouble, false), 4 * 0x1p-44 + largest * 0x1p-49);
}

}  // namespace
}  // namespace kdray::core
