// SPDX-License-Identifier: Apache-2.0
// The kernels' vector form of `exact` (bounds, preparation of rays, t and weights of four rays at a
// time) against ExactIntersection, bit for bit, where its bounds are about to leave a doubt: rays
// within ulps of corners, edges and planes, hits within ulps of each other and of the interval's
// ends, and numbers at both ends of the range of double.
#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <limits>
#include <span>
#include <vector>

#include "core/base/parallel.h"
#include "core/geometry/double_double.h"
#include "core/trace/brute_force.h"
#include "core/trace/trace.h"
#include "tests/property/scenes.h"
#include "tests/support/seed.h"
#include "tests/support/shapes.h"

namespace kdray::test {
namespace {

using namespace core;

constexpr double kInf = std::numeric_limits<double>::infinity();

/// `size` in one of the powers of two that lie around the bounds of filters.
double Nudge(std::mt19937_64& engine, double size) {
  return std::ldexp(Uniform(engine, -1, 1) * size, -static_cast<int>(engine() % 60));
}
Vec3d Nudged(const Vec3d& at, double size, std::mt19937_64& engine) {
  if (engine() % 3 == 0) return at;
  return at + Vec3d{Nudge(engine, size), Nudge(engine, size), Nudge(engine, size)};
}

Vec3d CornerOf(const MeshData& data, const TriangleIndices& triangle, std::size_t k) {
  return data.vertices[triangle[k]];
}

/// A point of a triangle: a corner, a point of an edge, or one inside.
Vec3d PointOn(const MeshData& data, const TriangleIndices& triangle, std::mt19937_64& engine) {
  const double weights[] = {0, 0.5, 1, Uniform(engine, 0, 1)};
  const double u = weights[engine() % 4];
  const double v = (1 - u) * weights[engine() % 4];
  return CornerOf(data, triangle, 0) * (1 - u - v) + CornerOf(data, triangle, 1) * u +
         CornerOf(data, triangle, 2) * v;
}

const TriangleIndices& AnyTriangle(const MeshData& data, std::mt19937_64& engine) {
  return data.triangles[engine() % data.triangles.size()];
}

/// Rays at and along triangles, from outside, from the surface and from next to it, some of which
/// end or begin at a hit or within ulps of it.
std::vector<Ray> HostileRays(const MeshData& data, double size, std::size_t count,
                             std::mt19937_64& engine) {
  std::vector<Ray> rays;
  while (rays.size() < count) {
    const TriangleIndices& triangle = AnyTriangle(data, engine);
    const Vec3d target = Nudged(PointOn(data, triangle, engine), size, engine);
    Vec3d origin;
    switch (engine() % 4) {
      case 0:
        origin =
            CornerOf(data, triangle, 0) +
            Vec3d{Uniform(engine, -2, 2), Uniform(engine, -2, 2), Uniform(engine, -2, 2)} * size;
        break;
      case 1:
        origin = PointOn(data, AnyTriangle(data, engine), engine);
        break;
      case 2:  // in the triangle's plane, or almost
        origin = Nudged(CornerOf(data, triangle, 0) * 3.0 - CornerOf(data, triangle, 1) -
                            CornerOf(data, triangle, 2),
                        size, engine);
        break;
      default:  // so near that t loses its digits
        origin = Nudged(target, size * 0x1p-40, engine);
    }
    Ray ray = RayTo(origin, target);
    if (engine() % 8 == 0) {
      ray.direction = {Uniform(engine, -1, 1), Uniform(engine, -1, 1), Uniform(engine, -1, 1)};
    }
    constexpr double kEnds[] = {0, 0.5, 1 - 0x1p-53, 1, 1 + 0x1p-52, 1 + 0x1p-47, kInf};
    ray.t_max = kEnds[engine() % std::size(kEnds)];
    if (engine() % 4 != 0) ray.t_max = kInf;
    ray.t_min = engine() % 2 == 0 ? 0 : -kEnds[engine() % std::size(kEnds)];
    if (engine() % 8 == 0) ray.t_min = kEnds[engine() % 6];
    if (IsValid(ray)) rays.push_back(ray);
  }
  return rays;
}

/// A small closed mesh, a layer 2^-40 to 2^-53 beside it, and slivers.
MeshData HostileMesh(std::mt19937_64& engine) {
  MeshData data = BumpySphere({0, 0, 0}, 0.7, 3, 5, 0.3);
  MeshData layer = data;
  for (Vec3d& v : layer.vertices) {
    v = v * (1 + std::ldexp(Uniform(engine, -1, 1), -40 - static_cast<int>(engine() % 14)));
  }
  data = Join(data, layer);
  data = Join(data, Cube({0, 0, 0}, 0.25));
  MeshData slivers = Soup(4, 0.5, 23);
  for (const TriangleIndices& t : slivers.triangles) {
    Vec3d& third = slivers.vertices[t[2]];
    third = Nudged((slivers.vertices[t[0]] + slivers.vertices[t[1]]) * 0.5, 0.01, engine);
  }
  return Join(data, slivers);
}

void Transform(double scale, const Vec3d& move, MeshData* data) {
  for (Vec3d& v : data->vertices) v = v * scale + move;
}

TEST(ExactKernels, AnswerAsTheScalarTestWhereBoundsLeaveDoubts) {
  auto engine = RandomEngine(410);
  for (const bool as_floats : {false, true}) {
    MeshData data = HostileMesh(engine);
    if (as_floats) data = RoundToFloat(data);
    ExpectSameAsBruteForce(data, HostileRays(data, 1, 3'000, engine), {Precision::kExact});
    if (HasFatalFailure()) return;
  }
}

TEST(ExactKernels, AnswerAsTheScalarTestFarFromTheWorldsOrigin) {
  auto engine = RandomEngine(411);
  MeshData data = RoundToFloat(HostileMesh(engine));
  Transform(1, {148376, 1234, -223423}, &data);
  std::vector<Ray> rays = HostileRays(data, 1, 2'000, engine);
  for (Ray& ray : rays) ray.origin = ray.origin + Vec3d{Nudge(engine, 1), Nudge(engine, 1), 0};
  ExpectSameAsBruteForce(data, rays, {Precision::kExact});
}

TEST(ExactKernels, AnswerAsTheScalarTestForOriginsThatLocalCoordinatesRound) {
  // The mesh so far from 0 that its frame has an origin, yet so near that rays begin near 0, where
  // doubles are finer than those of the difference.
  auto engine = RandomEngine(415);
  MeshData data = HostileMesh(engine);
  Transform(0.7, {6.5, -6.5, 6.5}, &data);
  const MeshFrame frame = MakeScene(data, BuildKind::kBox).mesh->frame();
  std::vector<Ray> rays;
  std::size_t rounded = 0;
  for (const Ray& ray : HostileRays(data, 1, 3'000, engine)) {
    const Vec3d target = ray.origin + ray.direction;
    rays.push_back(RayTo(Vec3d{Nudge(engine, 1), Nudge(engine, 1), Nudge(engine, 1)}, target));
    const Vec3d local = rays.back().origin - frame.origin;
    const bool is_rounded = TwoDifference(rays.back().origin.x, frame.origin.x).low != 0;
    rounded += is_rounded && std::ldexp(MaxAbs(local), -frame.exponent) <= 4 ? 1 : 0;
  }
  ASSERT_GT(rounded, 1'000u);
  ExpectSameAsBruteForce(data, rays, {Precision::kExact});
}

TEST(ExactKernels, AnswerAsTheScalarTestAtTheEndsOfTheRange) {
  auto engine = RandomEngine(412);
  for (const int exponent : {-1040, -1000, -405, -395, -100, 100, 126}) {
    MeshData data = HostileMesh(engine);
    Transform(std::ldexp(1, exponent), {0, 0, 0}, &data);
    std::vector<Ray> rays = HostileRays(data, std::ldexp(1, exponent), 400, engine);
    for (Ray& ray : rays) {
      const int longer = static_cast<int>(engine() % 3) * 300 - 300;
      Ray scaled = ray;
      for (int axis = 0; axis < 3; ++axis) {
        scaled.direction[axis] = std::ldexp(ray.direction[axis], longer);
      }
      scaled.t_min = std::ldexp(ray.t_min, -longer);
      scaled.t_max = std::ldexp(ray.t_max, -longer);
      constexpr double kOdd[] = {5e-324, -1e-310, 0.0, -0.0};
      if (engine() % 4 == 0)
        scaled.direction[static_cast<int>(engine() % 3)] = kOdd[engine() % std::size(kOdd)];
      if (engine() % 8 == 0)
        scaled.origin[static_cast<int>(engine() % 3)] = kOdd[engine() % std::size(kOdd)];
      if (IsValid(scaled)) ray = scaled;
    }
    ExpectSameAsBruteForce(data, rays, {Precision::kExact});
    if (HasFatalFailure()) return;
  }
}

TEST(ExactKernels, AnswerAsTheScalarTestForTrianglesSoSmallThatTheirVolumesUnderflow) {
  auto engine = RandomEngine(416);
  MeshData data = Cube({0, 0, 0}, 0.7);
  std::vector<Ray> rays;
  for (const int exponent : {-300, -448, -449, -450, -451, -500, -530}) {
    MeshData small = UvSphere({0, 0, 0}, std::ldexp(1, exponent), 2, 3);
    for (const Ray& ray : HostileRays(small, std::ldexp(1, exponent), 100, engine)) {
      rays.push_back(ray);
    }
    data = Join(data, small);
  }
  ExpectSameAsBruteForce(data, rays, {Precision::kExact});
}

TEST(ExactKernels, AnswerBatchesOfAnyLength) {
  // The last hits of a batch may fill no vector.
  auto engine = RandomEngine(413);
  const MeshData data = HostileMesh(engine);
  const Scene scene = MakeScene(data, BuildKind::kKdSah);
  const std::vector<Ray> rays = RandomRays(scene.mesh->bounds(), 40, engine);
  std::vector<Hit> expected;
  for (const Ray& ray : rays) {
    expected.push_back(BruteForceClosest(*scene.mesh, ray, Precision::kExact));
  }
  for (const TraceOptions& way : WaysToTrace(Precision::kExact)) {
    for (std::size_t count = 1; count <= rays.size(); ++count) {
      std::vector<Hit> hits(count);
      ASSERT_TRUE(TraceClosest(scene, std::span(rays).first(count), way, hits).ok());
      for (std::size_t i = 0; i < count; ++i) {
        ASSERT_EQ(hits[i], expected[i]) << Describe(way) << ", ray " << i << " of " << count;
      }
    }
  }
}

TEST(ExactKernels, AnswerFloatRaysAsTheSameRaysInDouble) {
  auto engine = RandomEngine(414);
  MeshData data = RoundToFloat(HostileMesh(engine));
  Transform(1, {3, -5, 11}, &data);
  const Scene scene = MakeScene(data, BuildKind::kKdSah);
  std::vector<RayF> floats;
  for (const Ray& ray : HostileRays(data, 1, 2'000, engine)) {
    const RayF narrow{Vec3f(ray.origin), static_cast<float>(ray.t_min), Vec3f(ray.direction),
                      static_cast<float>(ray.t_max)};
    if (IsValid(narrow)) floats.push_back(narrow);
  }
  for (const TraceOptions& way : WaysToTrace(Precision::kExact)) {
    std::vector<Hit> hits(floats.size());
    ASSERT_TRUE(TraceClosest(scene, std::span<const RayF>(floats), way, hits).ok());
    for (std::size_t i = 0; i < floats.size(); ++i) {
      const Ray wide = RayBatch(std::span<const RayF>(floats))[i];
      ASSERT_EQ(hits[i], ClosestHit(scene, wide, Precision::kExact)) << Describe(way);
    }
  }
}

TEST(ExactKernels, FindAHitAgainFromTheTThatTheyAnswered) {
  auto engine = RandomEngine(420);
  const MeshData data = Soup(200, 0.4, 421);
  const Scene scene = MakeScene(data, BuildKind::kKdSah);
  std::vector<Ray> rays = RandomRays(scene.mesh->bounds(), 500, engine);
  for (Ray& ray : rays) ray.origin = ray.origin - ray.direction * std::ldexp(1, engine() % 60);
  std::vector<Hit> first(rays.size());
  ASSERT_TRUE(TraceClosest(scene, std::span<const Ray>(rays), With(Precision::kExact), first).ok());
  std::vector<Ray> again;
  std::vector<Hit> want;
  for (std::size_t i = 0; i < rays.size(); ++i) {
    if (!first[i].IsHit()) continue;
    const double t = first[i].t;
    for (const auto& [t_min, t_max] : {std::pair{0.0, t}, {t, t}, {t, kInf}}) {
      if (!(t_min <= t_max)) continue;
      again.push_back(rays[i]);
      again.back().t_min = t_min;
      again.back().t_max = t_max;
      want.push_back(first[i]);
    }
  }
  ASSERT_GT(again.size(), 300u);
  for (const TraceOptions& way : WaysToTrace(Precision::kExact)) {
    std::vector<Hit> hits(again.size());
    std::vector<std::uint8_t> occluded(again.size());
    ASSERT_TRUE(TraceClosest(scene, std::span<const Ray>(again), way, hits).ok());
    ASSERT_TRUE(TraceAny(scene, std::span<const Ray>(again), way, occluded).ok());
    EXPECT_EQ(hits, want) << Describe(way);
    EXPECT_EQ(occluded, std::vector<std::uint8_t>(again.size(), 1)) << Describe(way);
  }
  const AllHits crossings =
      TraceAll(scene, std::span<const Ray>(again), With(Precision::kExact), 64).value();
  for (std::size_t i = 0; i < again.size(); ++i) {
    ASSERT_LT(crossings.first[i], crossings.first[i + 1]);
    EXPECT_EQ(crossings.hits[crossings.first[i]], want[i]);
    EXPECT_EQ(BruteForceClosest(*scene.mesh, again[i], Precision::kExact), want[i]);
  }
}

TEST(ExactKernels, AnswerAsTheScalarTestFromAnyDistance) {
  auto engine = RandomEngine(422);
  const MeshData data = HostileMesh(engine);
  std::vector<Ray> rays;
  for (const Ray& near : HostileRays(data, 1, 1'500, engine)) {
    Ray ray = near;
    // Of few bits, so that moving the origin loses nothing and rays still meet what they met.
    for (int axis = 0; axis < 3; ++axis) {
      ray.origin[axis] = std::round(std::ldexp(ray.origin[axis], 8)) * 0x1p-8;
      ray.direction[axis] = std::round(std::ldexp(ray.direction[axis], 8)) * 0x1p-8;
    }
    constexpr int kAway[] = {3, 20, 34, 40, 47, 60, 300};
    ray.origin = ray.origin - ray.direction * std::ldexp(1, kAway[engine() % std::size(kAway)]);
    ray.t_max = kInf;
    if (IsValid(ray)) rays.push_back(ray);
  }
  ExpectSameAsBruteForce(data, rays, {Precision::kExact});
}

TEST(FarOrigins, LoseNoHitInAnyPrecisionHoweverSmallTheMesh) {
  for (const int size : {100, 0, -30, -300, -700, -1000}) {
    const double mesh_size = std::ldexp(1, size);
    MeshData data;
    data.vertices = {{-mesh_size, -mesh_size, 0}, {mesh_size, -mesh_size, 0}, {0, mesh_size, 0}};
    data.triangles = {{0, 1, 2}};
    const Scene scene = MakeScene(data, BuildKind::kBox);
    for (const int away : {0, 20, 50, 100, 300, 700, 1000}) {
      for (const double x : {0.0, 1.0}) {
        Ray ray;
        ray.origin = Vec3d{x, x, 1} * std::ldexp(1, away);
        ray.direction = {-x, -x, -1};
        for (const Precision precision : kAllPrecisions) {
          const Hit hit = ClosestHit(scene, ray, precision);
          ASSERT_TRUE(hit.IsHit()) << Name(precision) << ", 2^" << size << " from 2^" << away;
          const double tolerance = precision == Precision::kExact ? 0 : 0x1p-20;
          EXPECT_LE(std::fabs(hit.t - ray.origin.z), tolerance * (ray.origin.z + mesh_size))
              << Name(precision) << ", 2^" << size << " from 2^" << away;
          for (const TraceOptions& way : WaysToTrace(precision)) {
            std::vector<Hit> hits(1);
            ASSERT_TRUE(TraceClosest(scene, std::span<const Ray>(&ray, 1), way, hits).ok());
            EXPECT_EQ(hits[0], hit) << Describe(way);
          }
        }
      }
    }
  }
}

/// Processor time of one run of all rays, in seconds: the least of several.
double LeastTime(const Scene& scene, const std::vector<Ray>& rays, Precision precision) {
  std::vector<Hit> hits(rays.size());
  double least = kInf;
  for (int run = 0; run < 7; ++run) {
    const std::clock_t begin = std::clock();
    EXPECT_TRUE(TraceClosest(scene, std::span<const Ray>(rays), With(precision), hits).ok());
    least = std::min(least, static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC);
  }
  return least;
}

// The aim is 5 times, and 3 to 6 is what was measured; the figures are printed. What must not come
// back took some 350 times: integers with allocation for every sign that is 0.
TEST(ExactKernels, SettleRaysAtVerticesAndEdgesWithoutBigIntegers) {
  constexpr int kPosts = 100;
  const auto height = [](int x, int y) { return 0.3 * std::sin(x) * std::cos(y); };
  MeshData data;
  for (int y = 0; y < kPosts; ++y) {
    for (int x = 0; x < kPosts; ++x) {
      data.vertices.push_back({static_cast<double>(x), static_cast<double>(y), height(x, y)});
    }
  }
  for (std::uint32_t y = 0; y + 1 < kPosts; ++y) {
    for (std::uint32_t x = 0; x + 1 < kPosts; ++x) {
      const std::uint32_t i = y * kPosts + x;
      data.triangles.push_back({i, i + 1, i + kPosts + 1});
      data.triangles.push_back({i, i + kPosts + 1, i + kPosts});
    }
  }
  const Scene scene = MakeScene(data, BuildKind::kKdSah);
  std::vector<Ray> down, at_vertices, on_edges;
  for (const Vec3d& v : data.vertices) {
    Ray ray;
    ray.origin = {v.x, v.y, 5};
    ray.direction = {0, 0, -1};
    down.push_back(ray);
    at_vertices.push_back(RayTo({49.3, 51.7, 40}, v));
    ray.origin = ray.origin + Vec3d{0.5, 0.5, 0};
    on_edges.push_back(ray);
  }
  Arena arena(1);
  arena.Run([&] {
    for (const auto& [name, rays] : {std::pair{"down at vertices", &down},
                                     {"at vertices", &at_vertices},
                                     {"down at middles of diagonals", &on_edges}}) {
      const double in_double = LeastTime(scene, *rays, Precision::kDouble);
      const double in_exact = LeastTime(scene, *rays, Precision::kExact);
      std::printf("%s: double %.2f us a ray, exact %.2f\n", name,
                  in_double * 1e6 / static_cast<double>(rays->size()),
                  in_exact * 1e6 / static_cast<double>(rays->size()));
      EXPECT_LE(in_exact, 20 * in_double) << name;
    }
  });
}

}  // namespace
}  // namespace kdray::test
