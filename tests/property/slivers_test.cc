// SPDX-License-Identifier: Apache-2.0
// N12, N13: triangles so thin, and rays so close to a triangle's plane, that rounded arithmetic
// loses them. `exact` answers as rational numbers do; how often the others differ is printed.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

#include "core/geometry/local_ray.h"
#include "core/trace/trace.h"
#include "tests/property/scenes.h"
#include "tests/support/rationals.h"
#include "tests/support/seed.h"
#include "tests/support/shapes.h"

namespace kdray::test {
namespace {

using namespace core;

Vec3d RandomVector(std::mt19937_64& engine) {
  return {Uniform(engine, -1, 1), Uniform(engine, -1, 1), Uniform(engine, -1, 1)};
}

/// Triangles `aspect` times as long as high.
MeshData Slivers(std::size_t count, double aspect, std::mt19937_64& engine) {
  MeshData data;
  for (std::size_t i = 0; i < count; ++i) {
    const Vec3d a = RandomVector(engine), b = RandomVector(engine);
    const Vec3d along = a + (b - a) * Uniform(engine, 0, 1);
    const Vec3d height = Normalized(Cross(b - a, RandomVector(engine))) * (Length(b - a) / aspect);
    const auto first = static_cast<std::uint32_t>(data.vertices.size());
    for (const Vec3d& v : {a, b, along + height}) data.vertices.push_back(v);
    data.triangles.push_back({first, first + 1, first + 2});
  }
  return data;
}

struct Tally {
  std::size_t rays = 0, hits = 0;
  std::array<std::size_t, kAllPrecisions.size()> different{};  // in hit or miss or triangle
};

/// `exact` is right in hit, triangle and t, and no precision has a hit beyond its triangle.
void Check(const MeshData& data, const std::vector<Ray>& rays, Tally* tally) {
  const Scene scene = MakeScene(data, BuildKind::kKdSah);
  const double unit = std::ldexp(1.0, scene.mesh->frame().exponent);
  for (const Ray& ray : rays) {
    const RationalClosestHit want = RationalClosest(data, ray);
    ++tally->rays;
    tally->hits += want.primitive_id == kNoPrimitive ? 0 : 1;
    for (const Precision precision : kAllPrecisions) {
      const Hit hit = ClosestHit(scene, ray, precision);
      if (hit.primitive_id != want.primitive_id)
        ++tally->different[static_cast<std::size_t>(precision)];
      if (hit.IsHit()) {
        double farthest = 0;
        for (const Vec3d& v : CornersOf(data, hit.primitive_id))
          farthest = std::max(farthest, Length(v - ray.origin));
        ASSERT_LE(hit.t * Length(ray.direction), farthest + 2 * kFloatPad * unit)
            << Name(precision);
      }
      if (precision != Precision::kExact) continue;
      ASSERT_EQ(hit.primitive_id, want.primitive_id) << "ray " << tally->rays;
      if (hit.IsHit()) {
        ASSERT_EQ(hit.t, RoundedToNearest(want.t)) << "ray " << tally->rays;
      }
    }
  }
}

void Print(const std::string& what, const Tally& tally) {
  std::printf(
      "%s: %zu rays, %zu hits; fast, watertight, double answer another triangle or none: "
      "%zu, %zu, %zu\n",
      what.c_str(), tally.rays, tally.hits,
      tally.different[static_cast<std::size_t>(Precision::kFast)],
      tally.different[static_cast<std::size_t>(Precision::kWatertight)],
      tally.different[static_cast<std::size_t>(Precision::kDouble)]);
}

/// At corners, edges and into the middle, from anywhere.
std::vector<Ray> RaysAt(const MeshData& data, std::size_t count, std::mt19937_64& engine) {
  std::vector<Ray> rays;
  while (rays.size() < count) {
    const auto corners =
        CornersOf(data, static_cast<PrimitiveId>(engine() % data.triangles.size()));
    double w[3] = {1, 0, 0};
    if (rays.size() % 3 > 0) w[1] = Uniform(engine, 0, 1);
    if (rays.size() % 3 > 1) w[2] = Uniform(engine, 0, 1);
    const double sum = w[0] + w[1] + w[2];
    const std::size_t k = engine() % 3;
    const Vec3d target = corners[k] * (w[0] / sum) + corners[(k + 1) % 3] * (w[1] / sum) +
                         corners[(k + 2) % 3] * (w[2] / sum);
    const Ray ray = RayTo(RandomVector(engine) * 1.5, target);
    if (IsValid(ray)) rays.push_back(ray);
  }
  return rays;
}

TEST(N12Slivers, SliversAnswerAsRationalNumbersDo) {
  auto engine = RandomEngine(1200);
  for (const double aspect : {1e3, 1e4, 1e5, 1e6, 1e7, 1e8}) {
    Tally tally;
    const MeshData data = Slivers(24, aspect, engine);
    Check(data, RaysAt(data, 1'000, engine), &tally);
    Check(RoundToFloat(data), RaysAt(RoundToFloat(data), 500, engine), &tally);
    if (HasFatalFailure()) return;
    char name[40];
    std::snprintf(name, sizeof(name), "N12 slivers 1:%.0e", aspect);
    Print(name, tally);
    EXPECT_GT(tally.hits, 100u);
  }
}

TEST(N12Slivers, TrianglesWithoutAreaAreHitByNothing) {
  auto engine = RandomEngine(1201);
  // Corners on lattice points: many are collinear or equal, exactly.
  const auto point = [&] {
    return Vec3d{double(engine() % 3), double(engine() % 3), double(engine() % 3)};
  };
  std::size_t flat = 0;
  Tally tally;
  for (int round = 0; round < 20; ++round) {
    MeshData data;
    for (std::uint32_t i = 0; i < 24; ++i) {
      for (int k = 0; k < 3; ++k) data.vertices.push_back(point());
      data.triangles.push_back({3 * i, 3 * i + 1, 3 * i + 2});
    }
    flat += TriangleMesh::Create(data).value().degenerate_count();
    std::vector<Ray> rays;
    while (rays.size() < 100) {
      Ray ray = RayTo(point(), point());
      if (rays.size() % 3 == 0) ray.origin = ray.origin - ray.direction * 2.0;
      if (IsValid(ray)) rays.push_back(ray);
    }
    Check(data, rays, &tally);
    if (HasFatalFailure()) return;
  }
  EXPECT_GT(flat, 40u);
  EXPECT_GT(tally.hits, 200u);
  Print("N12 flat triangles on a lattice", tally);
}

TEST(N13GrazingRays, GrazingRaysAnswerAsRationalNumbersDo) {
  auto engine = RandomEngine(1300);
  const MeshData data = RoundToFloat(Soup(24, 1.0, 1301));
  for (int power = 2; power <= 9; ++power) {
    const double angle = std::pow(10.0, -power);
    std::vector<Ray> rays;
    while (rays.size() < 700) {
      const auto [a, b, c] =
          CornersOf(data, static_cast<PrimitiveId>(engine() % data.triangles.size()));
      const double u = Uniform(engine, 0, 0.5), v = Uniform(engine, 0, 0.5);
      const Vec3d target = a * (1 - u - v) + b * u + c * v;
      const Vec3d normal = Normalized(Cross(b - a, c - a));
      const Vec3d in_plane =
          Normalized((b - a) * Uniform(engine, -1, 1) + (c - a) * Uniform(engine, -1, 1));
      Ray ray;
      ray.direction = in_plane + normal * (engine() % 2 == 0 ? angle : -angle);
      ray.origin = target - ray.direction * Uniform(engine, 0.1, 2);
      rays.push_back(ray);
    }
    Tally tally;
    Check(data, rays, &tally);
    if (HasFatalFailure()) return;
    char name[40];
    std::snprintf(name, sizeof(name), "N13 grazing at %.0e", angle);
    Print(name, tally);
    EXPECT_GT(tally.hits, 500u);
  }
}

TEST(N13GrazingRays, RaysInATrianglesPlaneDoNotHitIt) {
  auto engine = RandomEngine(1302);
  // Planes through lattice points contain lattice rays exactly.
  const MeshData data = Join(Grid(4, 0, 0.5), Join(Grid(4, 1, 0.5), Grid(4, 2, 0.5)));
  std::vector<Ray> rays;
  while (rays.size() < 1'500) {
    const int axis = static_cast<int>(engine() % 3);
    const auto point = [&] {
      Vec3d p{double(engine() % 9) / 8, double(engine() % 9) / 8, double(engine() % 9) / 8};
      p[axis] = 0.5;
      return p;
    };
    const Ray ray = RayTo(point(), point());
    if (IsValid(ray)) rays.push_back(ray);
  }
  Tally tally;
  Check(data, rays, &tally);
  Print("N13 in a plane", tally);
  const MeshData plane = Grid(4, 2, 0.5);
  const Scene scene = MakeScene(plane, BuildKind::kKdSah);
  for (const Ray& ray : rays) {
    if (ray.origin.z != 0.5 || ray.direction.z != 0) continue;
    for (const Precision precision : kAllPrecisions)
      ASSERT_FALSE(ClosestHit(scene, ray, precision).IsHit()) << Name(precision);
  }
}

}  // namespace
}  // namespace kdray::test
