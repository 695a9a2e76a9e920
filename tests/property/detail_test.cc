// SPDX-License-Identifier: Apache-2.0
// N14: features of a millimetre, kilometres from the origin, in metres.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdio>

#include "core/trace/trace.h"
#include "tests/property/scenes.h"
#include "tests/support/seed.h"

namespace kdray::test {
namespace {

using namespace core;

constexpr double kMillimetre = 1e-3;

/// A square of a millimetre, flat, its least corner there: two triangles.
void AddPlate(const Vec3d& corner, MeshData* data) {
  const auto first = static_cast<std::uint32_t>(data->vertices.size());
  for (const auto& [x, y] : {std::pair{0.0, 0.0}, {1.0, 0.0}, {1.0, 1.0}, {0.0, 1.0}})
    data->vertices.push_back(corner + Vec3d{x * kMillimetre, y * kMillimetre, 0});
  data->triangles.push_back({first, first + 1, first + 2});
  data->triangles.push_back({first, first + 2, first + 3});
}

/// How many of `rays` straight down at each plate find it, in each precision.
std::array<std::size_t, kAllPrecisions.size()> Found(const MeshData& data, std::size_t rays,
                                                     std::mt19937_64& engine) {
  const Scene scene = MakeScene(data, BuildKind::kKdSah);
  std::array<std::size_t, kAllPrecisions.size()> found{};
  for (std::uint32_t plate = 0; plate < data.triangles.size() / 2; ++plate) {
    const Vec3d& low = data.vertices[4 * plate];
    const Vec3d& high = data.vertices[4 * plate + 2];
    for (std::size_t i = 0; i < rays; ++i) {
      Ray ray;
      ray.origin = {low.x + (high.x - low.x) * Uniform(engine, 0.05, 0.95),
                    low.y + (high.y - low.y) * Uniform(engine, 0.05, 0.95), low.z + 1};
      ray.direction = {0, 0, -1};
      for (const Precision precision : kAllPrecisions) {
        const Hit hit = ClosestHit(scene, ray, precision);
        found[static_cast<std::size_t>(precision)] +=
            hit.IsHit() && hit.primitive_id / 2 == plate ? 1 : 0;
      }
    }
  }
  return found;
}

void ExpectFound(const char* what, double distance, const MeshData& data, std::size_t rays,
                 std::mt19937_64& engine) {
  const auto found = Found(data, rays, engine);
  const std::size_t all = rays * data.triangles.size() / 2;
  std::printf("N14 %s, %.0e m: fast finds %zu, watertight %zu, double %zu, exact %zu of %zu\n",
              what, distance, found[0], found[1], found[2], found[3], all);
  EXPECT_EQ(found[static_cast<std::size_t>(Precision::kDouble)], all) << distance;
  EXPECT_EQ(found[static_cast<std::size_t>(Precision::kExact)], all) << distance;
}

TEST(N14Detail, MillimetresAreFoundInASmallMeshFarFromTheOrigin) {
  auto engine = RandomEngine(1400);
  for (const double distance : {1e3, 1e4, 1e5, 1e6, 1e7, 1e8}) {
    MeshData data;
    for (int i = 0; i < 20; ++i)
      AddPlate({distance + 2 * kMillimetre * i, -distance, 0.5 * distance + kMillimetre * i},
               &data);
    ExpectFound("small mesh", distance, data, 200, engine);
  }
}

TEST(N14Detail, MillimetresAreFoundInAMeshOfKilometres) {
  auto engine = RandomEngine(1401);
  for (const double distance : {1e3, 1e4, 1e5, 1e6, 1e7, 1e8}) {
    MeshData data;
    for (int i = 0; i < 20; ++i) {
      const double far = i % 2 == 0 ? distance : -distance;
      AddPlate({far + 2 * kMillimetre * i, -far, kMillimetre * i}, &data);
    }
    const TriangleMesh mesh = TriangleMesh::Create(data).value();
    EXPECT_TRUE(mesh.has_double_vertices());
    EXPECT_EQ(AutoPrecision(mesh), Precision::kDouble);
    ExpectFound("large mesh", distance, data, 200, engine);
  }
}

}  // namespace
}  // namespace kdray::test
