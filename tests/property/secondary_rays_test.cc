// SPDX-License-Identifier: Apache-2.0
// N16: rays that start at hits do not hit the triangle that they leave, and do not pass over a
// surface that is more than 4 ulp of a float away.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <vector>

#include "core/trace/leave_surface.h"
#include "core/trace/trace.h"
#include "tests/property/closed_meshes.h"
#include "tests/property/scenes.h"
#include "tests/support/seed.h"
#include "tests/support/shapes.h"

namespace kdray::test {
namespace {

using namespace core;

std::size_t RaysOfAMesh() { return static_cast<std::size_t>(10'000 * RaysFactor()); }

std::vector<Hit> Closest(const Scene& scene, const std::vector<Ray>& rays, Precision precision) {
  std::vector<Hit> hits(rays.size());
  EXPECT_TRUE(TraceClosest(scene, std::span<const Ray>(rays), With(precision), hits).ok());
  return hits;
}

/// Directions all around, and some that graze the triangle.
Vec3d AnyDirection(const MeshData& data, const Hit& hit, std::mt19937_64& engine) {
  const Vec3d random{Uniform(engine, -1, 1), Uniform(engine, -1, 1), Uniform(engine, -1, 1)};
  if (engine() % 4 != 0) return random;
  const TriangleIndices& t = data.triangles[hit.primitive_id];
  const Vec3d edge = data.vertices[t[1]] - data.vertices[t[0]];
  return NormalizedAtAnyScale(edge) + random * std::pow(10.0, Uniform(engine, -6, -1));
}

TEST(N16SecondaryRays, RaysThatLeaveASurfaceDoNotHitItAgain) {
  auto engine = RandomEngine(1600);
  struct Case {
    const char* name;
    MeshData data;
  };
  std::vector<Case> cases;
  cases.push_back({"cube", Cube({0, 0, 0}, 1)});
  cases.push_back({"map", BumpySphere({448'251.25, 5'411'932.5, 122.75}, 40, 24, 40, 0.3)});
  for (const double scale : {1e-8, 1e-4, 1.0, 1e4, 1e8}) {
    cases.push_back(
        {"in float", RoundToFloat(BumpySphere(Vec3d{0.3, -0.2, 0.1} * scale, scale, 24, 40, 0.3))});
    cases.push_back({"in double", BumpySphere(Vec3d{0.3, -0.2, 0.1} * scale, scale, 24, 40, 0.3)});
  }
  for (const Case& c : cases) {
    const ClosedMesh mesh = MakeClosedMesh(c.name, c.data);
    std::vector<Ray> rays = RandomRays(mesh.scene.mesh->bounds(), RaysOfAMesh() / 2, engine);
    for (const Ray& ray : EdgeRays(mesh, RaysOfAMesh() / 2, engine)) rays.push_back(ray);
    for (const Precision precision : kAllPrecisions) {
      std::vector<Ray> secondary;
      std::vector<PrimitiveId> left;
      for (const Hit& hit : Closest(mesh.scene, rays, precision)) {
        if (!hit.IsHit()) continue;
        Ray ray;
        ray.direction = AnyDirection(mesh.data, hit, engine);
        ray.origin = LeaveSurface(*mesh.scene.mesh, hit, ray.direction, precision);
        secondary.push_back(ray);
        left.push_back(hit.primitive_id);
      }
      const std::vector<Hit> hits = Closest(mesh.scene, secondary, precision);
      std::size_t again = 0;
      for (std::size_t i = 0; i < hits.size(); ++i)
        again += hits[i].primitive_id == left[i] ? 1 : 0;
      EXPECT_EQ(again, 0u) << c.name << ", " << Name(precision) << ", of " << hits.size();
    }
  }
}

// Two spheres, the outer one a few ulps of a float larger: a ray that goes out through the inner
// one and starts anew there must meet the outer one.
TEST(N16SecondaryRays, ASurfaceCloseByIsNotPassedOver) {
  auto engine = RandomEngine(1601);
  for (const double scale : {1e-8, 1.0, 1e8}) {
    const double ulp = scale * 0x1p-23;
    for (const double gap : {4.5, 8.0, 100.0}) {
      const MeshData inner = IcoSphere({0, 0, 0}, scale, 3);
      const MeshData both = Join(inner, IcoSphere({0, 0, 0}, scale + gap * ulp, 3));
      const Scene scene = MakeScene(both, BuildKind::kKdSah);
      std::vector<Ray> rays;
      while (rays.size() < RaysOfAMesh() / 2) {
        Ray ray;
        ray.direction = {Uniform(engine, -1, 1), Uniform(engine, -1, 1), Uniform(engine, -1, 1)};
        rays.push_back(ray);
      }
      for (const Precision precision : kAllPrecisions) {
        std::vector<Ray> onward;
        for (std::size_t i = 0; const Hit& hit : Closest(scene, rays, precision)) {
          Ray ray = rays[i++];
          if (!hit.IsHit() || hit.primitive_id >= inner.triangles.size()) continue;
          ray.origin = LeaveSurface(*scene.mesh, hit, ray.direction, precision);
          onward.push_back(ray);
        }
        std::size_t passed = 0;
        for (const Hit& hit : Closest(scene, onward, precision))
          passed += hit.IsHit() && hit.primitive_id >= inner.triangles.size() ? 0 : 1;
        if (precision == Precision::kFast) continue;  // leaks
        EXPECT_EQ(passed, 0u) << Name(precision) << ", gap " << gap << " ulp, of " << onward.size();
        EXPECT_GT(onward.size(), rays.size() / 4);
      }
    }
  }
}

}  // namespace
}  // namespace kdray::test
