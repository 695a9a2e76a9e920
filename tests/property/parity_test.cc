// SPDX-License-Identifier: Apache-2.0
// N21: the number of crossings of a ray with a closed mesh is odd from inside and even from
// outside, through edges and corners, along sides and where it only touches.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>

#include "core/trace/trace.h"
#include "tests/property/closed_meshes.h"
#include "tests/property/scenes.h"
#include "tests/support/mesh_files.h"
#include "tests/support/seed.h"
#include "tests/support/shapes.h"

namespace kdray::test {
namespace {

using namespace core;

std::size_t RaysAMesh() {
  return static_cast<std::size_t>(20'000 * std::max(1.0, RaysFactor() / 10));
}

/// The rays moved back to before the mesh, so that they come from outside.
std::vector<Ray> FromOutside(const ClosedMesh& mesh, std::vector<Ray> rays) {
  const double size = 2 * MaxAbs(mesh.scene.mesh->bounds().Extent());
  for (Ray& ray : rays)
    ray.origin = ray.origin - NormalizedAtAnyScale(ray.direction) * (1.25 * size);
  return rays;
}

std::size_t CountWrong(const ClosedMesh& mesh, const std::vector<Ray>& rays, std::uint32_t parity,
                       std::uint32_t most) {
  std::vector<std::uint32_t> counts(rays.size());
  EXPECT_TRUE(
      TraceCount(mesh.scene, std::span<const Ray>(rays), With(Precision::kExact), counts).ok());
  return static_cast<std::size_t>(
      std::count_if(counts.begin(), counts.end(),
                    [&](std::uint32_t count) { return count % 2 != parity || count > most; }));
}

/// `is_convex`: then a ray crosses the mesh once from inside, and at most twice.
void ExpectParity(const ClosedMesh& mesh, bool is_convex, std::uint64_t stream,
                  std::size_t count = RaysAMesh()) {
  auto engine = RandomEngine(stream);
  const std::size_t each = count / 6;
  std::size_t rays = 0, wrong = 0;
  for (const auto& family : {VertexRays, EdgeRays, AxisRaysThroughVertices}) {
    for (std::size_t done = 0; done < each;) {
      const std::vector<Ray> block =
          family(mesh, std::min<std::size_t>(each - done, 50'000), engine);
      if (block.empty()) break;
      wrong += CountWrong(mesh, block, 1, is_convex ? 1 : 0xffffffff);
      wrong += CountWrong(mesh, FromOutside(mesh, block), 0, is_convex ? 2 : 0xffffffff);
      done += block.size();
      rays += 2 * block.size();
    }
  }
  EXPECT_EQ(wrong, 0u) << mesh.name;
  std::printf("| N21 parity | %s | exact | %zu | %zu | < %.1e | | | | | |\n", mesh.name.c_str(),
              rays, wrong, 3 / static_cast<double>(rays));
}

TEST(N21Parity, ParityIsRightThroughEdgesAndVerticesOfGeneratedMeshes) {
  ExpectParity(MakeClosedMesh("cube", Cube({0, 0, 0}, 1)), true, 2101);
  ExpectParity(MakeClosedMesh("sphere", IcoSphere({0.1, 0.2, 0.3}, 1, 4)), false, 2102);
  ExpectParity(MakeClosedMesh("bumpy sphere", RoundToFloat(BumpySphere({0, 0, 0}, 1, 40, 80, 0.3))),
               false, 2103);
}

TEST(N21Parity, ParityIsRightThroughEdgesAndVerticesOfTheCollectionsClosedMeshes) {
  KDRAY_NEED_MESHES();
  std::uint64_t stream = 2110;
  const std::vector<std::string> files = ClosedCollectionFiles();
  const std::size_t count = 4 * RaysAMesh() / files.size();
  for (const std::string& file : files)
    ExpectParity(MakeClosedMesh(file, ReadCollectionMesh(file)), false, stream++, count);
}

// Every line through two points of a lattice on which the corners of the solids lie too, so that
// lines run along sides, edges and diagonals, and each point is inside or outside by arithmetic on
// small integers.
TEST(N21Parity, ParityIsRightForEveryRayOfASmallWorld) {
  const MeshData data = Join(Cube({2, 2, 2}, 1), Cube({5, 2, 2}, 1));
  const auto is_outside = [](const Vec3d& p) {
    return p.x < 1 || p.x > 6 || (p.x > 3 && p.x < 4) || p.y < 1 || p.y > 3 || p.z < 1 || p.z > 3;
  };
  const auto is_inside = [](const Vec3d& p) {
    return ((p.x > 1 && p.x < 3) || (p.x > 4 && p.x < 6)) && p.y > 1 && p.y < 3 && p.z > 1 &&
           p.z < 3;
  };
  std::vector<Vec3d> points;
  for (int x = 0; x <= 14; ++x) {
    for (int y = 0; y <= 4; ++y) {
      for (int z = 0; z <= 4; ++z) points.push_back({x * 0.5, double(y), double(z)});
    }
  }
  std::vector<Ray> rays;
  std::vector<std::uint32_t> want;
  for (const Vec3d& from : points) {
    if (!is_inside(from) && !is_outside(from)) continue;  // on the surface
    for (std::size_t i = 0; i < points.size(); i += 2) {
      const Vec3d& to = points[i];
      if (from == to) continue;
      rays.push_back(RayTo(from, to));
      want.push_back(is_inside(from) ? 1 : 0);
    }
  }
  for (const Scene& scene : MakeScenes(data)) {
    std::vector<std::uint32_t> counts(rays.size());
    ASSERT_TRUE(
        TraceCount(scene, std::span<const Ray>(rays), With(Precision::kExact), counts).ok());
    std::size_t wrong = 0;
    for (std::size_t i = 0; i < rays.size(); ++i) wrong += counts[i] % 2 == want[i] ? 0 : 1;
    EXPECT_EQ(wrong, 0u) << Name(scene.tree->build) << ", of " << rays.size();
  }
}

}  // namespace
}  // namespace kdray::test
