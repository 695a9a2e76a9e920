// The engines' vector form of `exact` (bounds, preparation of rays, t and weights of four rays at a
// time) against ExactTest, bit for bit, where its bounds are about to leave a doubt: rays within
// ulps of corners, edges and planes, hits within ulps of each other and of the interval's ends, and
// numbers at both ends of the range of double.
#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <limits>
#include <span>
#include <vector>

#include "core/trace/brute_force.h"
#include "core/trace/double_double.h"
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

TEST(ExactEngines, AnswerAsTheScalarTestWhereBoundsLeaveDoubts) {
  auto engine = RandomEngine(410);
  for (const bool as_floats : {false, true}) {
    MeshData data = HostileMesh(engine);
    if (as_floats) data = RoundToFloat(data);
    ExpectSameAsBruteForce(data, HostileRays(data, 1, 3'000, engine), {Precision::kExact});
    if (HasFatalFailure()) return;
  }
}

TEST(ExactEngines, AnswerAsTheScalarTestFarFromTheWorldsOrigin) {
  auto engine = RandomEngine(411);
  MeshData data = RoundToFloat(HostileMesh(engine));
  Transform(1, {148376, 1234, -223423}, &data);
  std::vector<Ray> rays = HostileRays(data, 1, 2'000, engine);
  for (Ray& ray : rays) ray.origin = ray.origin + Vec3d{Nudge(engine, 1), Nudge(engine, 1), 0};
  ExpectSameAsBruteForce(data, rays, {Precision::kExact});
}

TEST(ExactEngines, AnswerAsTheScalarTestForOriginsThatLocalCoordinatesRound) {
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

TEST(ExactEngines, AnswerAsTheScalarTestAtTheEndsOfTheRange) {
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

TEST(ExactEngines, AnswerAsTheScalarTestForTrianglesSoSmallThatTheirVolumesUnderflow) {
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

TEST(ExactEngines, AnswerBatchesOfAnyLength) {
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

TEST(ExactEngines, AnswerFloatRaysAsTheSameRaysInDouble) {
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

}  // namespace
}  // namespace kdray::test
