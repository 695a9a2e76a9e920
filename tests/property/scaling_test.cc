// SPDX-License-Identifier: Apache-2.0
// N05: a mesh and its rays scaled by a power of two answer the same triangle and weights, and t
// scaled, bit for bit.
#include <gtest/gtest.h>

#include <cmath>

#include "core/trace/trace.h"
#include "tests/property/scenes.h"
#include "tests/support/seed.h"
#include "tests/support/shapes.h"

namespace kdray::test {
namespace {

using namespace core;

Vec3d Scaled(const Vec3d& v, int k) {
  return {std::ldexp(v.x, k), std::ldexp(v.y, k), std::ldexp(v.z, k)};
}

TEST(N05PowersOfTwo, ScalingByPowersOfTwoChangesNoBit) {
  const MeshData data = RoundToFloat(BumpySphere({0.3, -0.2, 0.1}, 1, 30, 60, 0.3));
  const Scene scene = MakeScene(data, BuildKind::kKdSah);
  auto engine = RandomEngine(5);
  constexpr std::size_t kRaysPerScale = 1000;  // 201 scales
  std::vector<Ray> rays = RandomRays(scene.mesh->bounds(), kRaysPerScale / 2, engine);
  for (const Ray& ray : RaysAtVertices(data, {0.31, -0.21, 0.12}, kRaysPerScale / 2))
    rays.push_back(ray);
  for (Ray& ray : rays) {
    if (Uniform(engine, 0, 1) < 0.3) ray.t_max = Uniform(engine, 0, 2);
  }

  std::vector<std::vector<Hit>> expected;
  for (const Precision precision : kAllPrecisions) {
    expected.emplace_back(rays.size());
    ASSERT_TRUE(
        TraceClosest(scene, std::span<const Ray>(rays), With(precision), expected.back()).ok());
  }
  for (int k = -100; k <= 100; ++k) {
    MeshData scaled = data;
    for (Vec3d& v : scaled.vertices) v = Scaled(v, k);
    const Scene scaled_scene = MakeScene(scaled, BuildKind::kKdMedian);
    for (std::size_t p = 0; p < expected.size(); ++p) {
      const Precision precision = kAllPrecisions[p];
      for (std::size_t i = 0; i < rays.size(); ++i) {
        if (precision == Precision::kExact && i % 20 != 0)
          continue;  // slow at vertices, and scales like the others
        // A direction of unchanged length makes t grow with the mesh; a scaled one leaves it alone.
        const bool scale_direction = i % 2 == 0;
        Ray ray = rays[i];
        ray.origin = Scaled(ray.origin, k);
        if (scale_direction) {
          ray.direction = Scaled(ray.direction, k);
        } else {
          ray.t_max = std::ldexp(ray.t_max, k);
        }
        const Hit hit = ClosestHit(scaled_scene, ray, precision);
        Hit want = expected[p][i];
        if (!scale_direction) want.t = std::ldexp(want.t, k);
        ASSERT_EQ(hit, want) << "2^" << k << ", " << Name(precision) << ", ray " << i;
      }
    }
  }
}

}  // namespace
}  // namespace kdray::test
