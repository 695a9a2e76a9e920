// SPDX-License-Identifier: Apache-2.0
// `count` and `all` answer what brute force answers, bit for bit, in every build, kernel, SIMD
// level and precision: each triangle once, nearest first, at most a given number for a ray.
// `closest`, `any`, `count` and `all` leave out the same hits: those on a culled side, and those on
// the surfaces that a ray begins and ends on.
#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "core/base/parallel.h"
#include "core/trace/brute_force.h"
#include "core/trace/trace.h"
#include "tests/property/closed_meshes.h"
#include "tests/property/scenes.h"
#include "tests/support/seed.h"
#include "tests/support/shapes.h"

namespace kdray::test {
namespace {

using namespace core;

constexpr std::size_t kEvery = 1'000'000;

/// What TraceOptions says about hits that do not count; the rest is a way to trace.
struct Filter {
  std::string name;
  Cull cull = Cull::kNone;
  bool starts = false, ends = false;
};
const std::vector<Filter> kNoFilter = {{"no filter"}};
const std::vector<Filter> kFilters = {{"cull back", Cull::kBack},
                                      {"cull front", Cull::kFront},
                                      {"auto start", Cull::kNone, true},
                                      {"auto end", Cull::kNone, false, true},
                                      {"auto, cull back", Cull::kBack, true, true}};

/// The answers of every query to one ray.
struct RayAnswers {
  Hit closest;
  std::vector<Hit> all;
};

RayAnswers BruteForce(const TriangleMesh& mesh, Ray ray, Precision precision,
                      const HitFilter::Options& filter) {
  if (filter.ends_on_surface && IsValid(ray)) {
    if (ray.t_min > 1) return {};
    ray.t_max = std::min(ray.t_max, 1.0);
  }
  return {BruteForceClosest(mesh, ray, precision, filter),
          BruteForceAll(mesh, ray, precision, filter)};
}

bool SameBits(const Hit& a, const Hit& b) {
  const auto bits = [](double x) { return std::bit_cast<std::uint64_t>(x); };
  return bits(a.t) == bits(b.t) && bits(a.u) == bits(b.u) && bits(a.v) == bits(b.v) &&
         a.primitive_id == b.primitive_id;
}

/// All four queries by one way to trace, `all` with and without a limit.
template <class AnyRay>
void ExpectAnswers(const Scene& scene, std::span<const AnyRay> rays, const TraceOptions& way,
                   const std::vector<RayAnswers>& want, const std::string& what) {
  std::vector<Hit> hits(rays.size());
  std::vector<std::uint8_t> occluded(rays.size());
  std::vector<std::uint32_t> counts(rays.size());
  ASSERT_TRUE(TraceClosest(scene, rays, way, hits).ok());
  ASSERT_TRUE(TraceAny(scene, rays, way, occluded).ok());
  ASSERT_TRUE(TraceCount(scene, rays, way, counts).ok());
  for (std::size_t i = 0; i < rays.size(); ++i) {
    ASSERT_TRUE(SameBits(hits[i], want[i].closest))
        << what << ", ray " << i << ": " << hits[i].t << " on " << hits[i].primitive_id
        << ", brute force " << want[i].closest.t << " on " << want[i].closest.primitive_id;
    ASSERT_EQ(occluded[i] != 0, want[i].closest.IsHit()) << what << ", ray " << i;
    ASSERT_EQ(counts[i], want[i].all.size()) << what << ", ray " << i;
  }
  for (const std::size_t most : {kEvery, std::size_t{2}}) {
    const AllHits all = TraceAll(scene, rays, way, most).value();
    std::size_t truncated = 0;
    ASSERT_EQ(all.first.size(), rays.size() + 1);
    ASSERT_EQ(all.first.back(), all.hits.size());
    for (std::size_t i = 0; i < rays.size(); ++i) {
      const std::size_t kept = std::min(most, want[i].all.size());
      ASSERT_EQ(all.first[i + 1] - all.first[i], kept) << what << ", ray " << i;
      for (std::size_t k = 0; k < kept; ++k) {
        const Hit& hit = all.hits[all.first[i] + k];
        ASSERT_TRUE(SameBits(hit, want[i].all[k]))
            << what << ", ray " << i << ", hit " << k << ": " << hit.t << " on " << hit.primitive_id
            << ", brute force " << want[i].all[k].t << " on " << want[i].all[k].primitive_id;
      }
      if (kept == want[i].all.size()) continue;
      ASSERT_LT(truncated, all.truncated.size());
      ASSERT_EQ(all.truncated[truncated++], i);
    }
    ASSERT_EQ(truncated, all.truncated.size()) << what;
  }
}

/// Every build by the usual way, and every way by one build after the other.
void ExpectSameAsBruteForce(const MeshData& data, const std::vector<Ray>& rays,
                            const std::vector<Filter>& filters) {
  const std::vector<Scene> scenes = MakeScenes(data);
  const TriangleMesh& mesh = *scenes[0].mesh;
  for (const Precision precision : kAllPrecisions) {
    for (const Filter& filter : filters) {
      const double offset = SurfaceOffset(mesh, precision, false);
      std::vector<RayAnswers> want;
      for (const Ray& ray : rays) {
        want.push_back(
            BruteForce(mesh, ray, precision, {filter.cull, filter.starts, filter.ends, offset}));
      }
      const std::vector<TraceOptions> ways = WaysToTrace(precision);
      for (std::size_t k = 0; k < std::max(scenes.size(), ways.size()); ++k) {
        const Scene& scene = scenes[k % scenes.size()];
        TraceOptions way = k < scenes.size() ? ways[0] : ways[k % ways.size()];
        way.cull = filter.cull;
        way.starts_on_surface = filter.starts;
        way.ends_on_surface = filter.ends;
        way.surface_offset = offset;
        ExpectAnswers(
            scene, std::span<const Ray>(rays), way, want,
            std::string(Name(scene.tree->build)) + ", " + Describe(way) + ", " + filter.name);
        if (testing::Test::HasFatalFailure()) return;
      }
    }
  }
}

/// Random rays, and rays through vertices and along edges; some with an interval of their own, some
/// invalid.
std::vector<Ray> MixedRays(const MeshData& data, const Bounds3d& bounds, std::size_t count,
                           std::mt19937_64& engine) {
  std::vector<Ray> rays = RandomRays(bounds, count, engine);
  const auto corner = [&] {
    return data.vertices[data.triangles[engine() % data.triangles.size()][engine() % 3]];
  };
  for (const Ray& ray : RaysAtVertices(data, PointIn(bounds, engine), count / 2)) {
    rays.push_back(ray);
  }
  for (const Ray& ray : RaysOnEdges(data, PointIn(bounds, engine), count / 2, engine)) {
    rays.push_back(ray);
  }
  for (std::size_t i = 0; i < count / 2;
       ++i) {  // from the surface to the surface, or along an axis
    Ray ray = RayTo(corner(), corner());
    if (i % 4 == 0) {
      ray.direction = {};
      ray.direction[static_cast<int>(i / 4 % 3)] = i % 8 == 0 ? 1 : -1;
    }
    rays.push_back(ray);
  }
  for (std::size_t i = 0; i < rays.size(); ++i) {
    if (i % 5 == 1) rays[i].t_max = Uniform(engine, 0, 2);
    if (i % 7 == 2) rays[i].t_min = Uniform(engine, -2, 2);
    if (i % 31 == 3) rays[i].t_max = std::numeric_limits<double>::quiet_NaN();
  }
  return rays;
}

std::vector<MeshData> Meshes() {
  MeshData lattice = Join(Cube({2, 2, 2}, 1), Cube({2, 2, 3}, 2));
  return {RoundToFloat(BumpySphere({0.3, -0.2, 0.1}, 1, 10, 14, 0.3)),
          UvSphere({448'251.25, 5'411'932.5, 122.75}, 10, 8, 12), std::move(lattice),
          Join(Soup(150, 0.5, 3), Coincident(12))};
}

TEST(AllHits, AreThoseOfBruteForceInEveryBuildKernelAndPrecision) {
  auto engine = RandomEngine(2201);
  for (const MeshData& data : Meshes()) {
    const Bounds3d bounds = MakeScene(data, BuildKind::kBox).mesh->bounds();
    ExpectSameAsBruteForce(data, MixedRays(data, bounds, 120, engine), kNoFilter);
    if (HasFatalFailure()) return;
  }
}

TEST(HitFilter, LeavesOutTheSameHitsInEveryQueryBuildKernelAndPrecision) {
  auto engine = RandomEngine(2202);
  for (const MeshData& data : Meshes()) {
    const Bounds3d bounds = MakeScene(data, BuildKind::kBox).mesh->bounds();
    ExpectSameAsBruteForce(data, MixedRays(data, bounds, 40, engine), kFilters);
    if (HasFatalFailure()) return;
  }
}

TEST(AllHits, OfManyRaysDependOnNeitherThreadsNorSortingNorTheNumberType) {
  auto engine = RandomEngine(2203);
  const MeshData data = RoundToFloat(BumpySphere({0, 0, 0}, 1, 30, 40, 0.3));
  const Scene scene = MakeScene(data, BuildKind::kKdSah);
  std::vector<RayF> floats;
  std::vector<Ray> doubles;
  for (const Ray& ray : RandomRays(scene.mesh->bounds(), 20'000, engine)) {
    floats.push_back({Vec3f(ray.origin), 0, Vec3f(ray.direction), INFINITY});
    doubles.push_back(RayBatch(std::span<const RayF>(floats))[floats.size() - 1]);
  }
  for (const Precision precision : kAllPrecisions) {
    for (const bool ends : {false, true}) {
      TraceOptions way = With(precision);
      way.ends_on_surface = ends;
      way.surface_offset = SurfaceOffset(*scene.mesh, precision, true);
      const AllHits want = TraceAll(scene, std::span<const Ray>(doubles), way, 3).value();
      std::vector<std::uint32_t> counts(floats.size());
      ASSERT_TRUE(TraceCount(scene, std::span<const RayF>(floats), way, counts).ok());
      for (const int threads : {1, 3}) {
        for (const bool sort : {false, true}) {
          way.sort = sort;
          Arena arena(threads);
          arena.Run([&] {
            const AllHits got = TraceAll(scene, std::span<const RayF>(floats), way, 3).value();
            ASSERT_EQ(got.hits, want.hits) << Name(precision);
            ASSERT_EQ(got.first, want.first);
            ASSERT_EQ(got.truncated, want.truncated);
          });
          if (HasFatalFailure()) return;
        }
      }
      std::size_t more = 0;
      for (std::size_t i = 0; i < counts.size(); ++i) {
        ASSERT_EQ(std::min(counts[i], 3u), want.first[i + 1] - want.first[i]);
        more += counts[i] > 3 ? 1 : 0;
      }
      ASSERT_EQ(more, want.truncated.size());
    }
  }
}

/// Parallel triangles over each other, all hit by a ray along z; they have `levels` distances, so
/// several have equal t.
MeshData Stack(std::uint32_t count, std::uint32_t levels) {
  MeshData data;
  for (std::uint32_t i = 0; i < count; ++i) {
    const double z = static_cast<double>(i % levels) / levels;
    const auto first = static_cast<std::uint32_t>(data.vertices.size());
    for (const Vec3d& corner : {Vec3d{-1, -1, z}, Vec3d{1, -1, z}, Vec3d{0, 2, z}}) {
      data.vertices.push_back(corner);
    }
    data.triangles.push_back({first, first + 1, first + 2});
  }
  return data;
}

TEST(AllHits, OfARayThroughAHundredThousandTrianglesAreTheNearestInOrder) {
  constexpr std::uint32_t kCount = 100'000, kLevels = 1'000;
  for (const BuildKind build : {BuildKind::kBvh, BuildKind::kKdSah}) {
    const Scene scene = MakeScene(Stack(kCount, kLevels), build);
    std::vector<Ray> rays(3);
    for (Ray& ray : rays) {
      ray.origin = {0.125, 0.25, -1};
      ray.direction = {0, 0, 1};
    }
    rays[1].origin.z = 2;
    rays[1].direction.z = -1;
    for (const Precision precision : kAllPrecisions) {
      std::vector<std::uint32_t> counts(rays.size());
      ASSERT_TRUE(TraceCount(scene, std::span<const Ray>(rays), With(precision), counts).ok());
      EXPECT_EQ(counts, std::vector<std::uint32_t>(3, kCount)) << Name(precision);
      // 100 triangles of each level have one t; the third ray's limit is within the second level.
      const AllHits all = TraceAll(scene, std::span<const Ray>(rays), With(precision), 150).value();
      ASSERT_EQ(all.hits.size(), 450u);
      EXPECT_EQ(all.truncated, (std::vector<std::size_t>{0, 1, 2}));
      for (std::uint32_t k = 0; k < 150; ++k) {
        EXPECT_EQ(all.hits[k].primitive_id, k / 100 + kLevels * (k % 100)) << Name(precision);
        EXPECT_EQ(all.hits[150 + k].primitive_id, kLevels - 1 - k / 100 + kLevels * (k % 100));
      }
    }
  }
}

TEST(AllHits, EndWithTooManyOnceTheBatchHasMoreThanTheLimit) {
  const Scene scene = MakeScene(Stack(1'000, 1'000), BuildKind::kKdSah);
  Ray ray;
  ray.origin = {0.125, 0.25, -1};
  ray.direction = {0, 0, 1};
  const std::vector<Ray> rays(20'000, ray);
  const std::span<const Ray> batch(rays);
  for (const Precision precision : {Precision::kWatertight, Precision::kExact}) {
    const TraceOptions way = With(precision);
    const AllHits few = TraceAll(scene, batch.first(500), way, 10, 5'000).value();
    EXPECT_FALSE(few.too_many);
    EXPECT_EQ(few.hits.size(), 5'000u);
    for (const std::size_t count : {std::size_t{501}, rays.size()}) {
      const AllHits many = TraceAll(scene, batch.first(count), way, 10, 5'000).value();
      EXPECT_TRUE(many.too_many);
      EXPECT_TRUE(many.hits.empty());
    }
  }
}

TEST(Cull, LeavesTheHitsOfTheOtherSideOnly) {
  auto engine = RandomEngine(2204);
  // The same surface with its triangles turned over has front and back exchanged.
  MeshData outward = RoundToFloat(BumpySphere({0, 0, 0}, 1, 20, 30, 0.3));
  MeshData inward = outward;
  for (TriangleIndices& t : inward.triangles) std::swap(t[1], t[2]);
  const Scene scene = MakeScene(outward, BuildKind::kKdSah);
  const Scene turned = MakeScene(inward, BuildKind::kKdSah);
  std::vector<Ray> rays = RandomRays(scene.mesh->bounds(), 5'000, engine);
  for (const Precision precision : kAllPrecisions) {
    TraceOptions way = With(precision);
    const AllHits every = TraceAll(scene, std::span<const Ray>(rays), way, kEvery).value();
    for (const Cull cull : {Cull::kBack, Cull::kFront}) {
      way.cull = cull;
      const AllHits kept = TraceAll(scene, std::span<const Ray>(rays), way, kEvery).value();
      HugeVector<Hit> want;
      for (std::size_t i = 0; i < rays.size(); ++i) {
        for (std::size_t k = every.first[i]; k < every.first[i + 1]; ++k) {
          const bool front = SideMet(*scene.mesh, rays[i], every.hits[k].primitive_id) > 0;
          if (front == (cull == Cull::kBack)) want.push_back(every.hits[k]);
        }
      }
      EXPECT_EQ(kept.hits, want) << Name(precision) << ", " << Name(cull);
      TraceOptions opposite = way;
      opposite.cull = cull == Cull::kBack ? Cull::kFront : Cull::kBack;
      const AllHits other = TraceAll(turned, std::span<const Ray>(rays), opposite, kEvery).value();
      EXPECT_EQ(other.first, kept.first) << Name(precision) << ", " << Name(cull);
    }
  }
}

// N16 by `auto`: rays that leave a vertex into the inside of a closed mesh, or a point of its
// surface as it is answered, find the far side.
TEST(N16Auto, RaysFromTheSurfaceIntoAClosedMeshFindTheFarSide) {
  auto engine = RandomEngine(2205);
  for (const double scale : {1e-8, 1.0, 1e8}) {
    for (const bool in_float : {false, true}) {
      MeshData data = IcoSphere(Vec3d{0.3, -0.2, 0.1} * scale, scale, 3);
      if (in_float) data = RoundToFloat(data);
      const Scene scene = MakeScene(data, BuildKind::kKdSah);
      const Vec3d middle = scene.mesh->bounds().Center();
      std::vector<Ray> doubles;
      std::vector<RayF> floats;
      for (int i = 0; i < 4'000; ++i) {
        const TriangleIndices& t = data.triangles[engine() % data.triangles.size()];
        const Vec3d& a = data.vertices[t[0]];
        const double u = Uniform(engine, 0.1, 0.4), v = Uniform(engine, 0.1, 0.4);
        const Vec3d point =
            i % 2 == 0 ? a : a * (1 - u - v) + data.vertices[t[1]] * u + data.vertices[t[2]] * v;
        // Inwards, not along the surface.
        const Vec3d target =
            middle + Vec3d{Uniform(engine, -1, 1), Uniform(engine, -1, 1), Uniform(engine, -1, 1)} *
                         (0.5 * scale);
        doubles.push_back(RayTo(point, target));
        floats.push_back({Vec3f(point), 0, Vec3f(target) - Vec3f(point), INFINITY});
      }
      for (const Precision precision : kAllPrecisions) {
        if (precision == Precision::kFast) continue;  // leaks
        for (const bool float_rows : {false, true}) {
          TraceOptions way = With(precision);
          way.starts_on_surface = true;
          way.surface_offset = SurfaceOffset(*scene.mesh, precision, float_rows);
          const RayBatch rays = float_rows ? RayBatch(std::span<const RayF>(floats))
                                           : RayBatch(std::span<const Ray>(doubles));
          std::vector<Hit> hits(rays.size());
          std::vector<std::uint32_t> counts(rays.size());
          ASSERT_TRUE(TraceClosest(scene, rays, way, hits).ok());
          way.precision = Precision::kExact;
          ASSERT_TRUE(TraceCount(scene, rays, way, counts).ok());
          std::size_t missed = 0, near = 0, wrong = 0;
          for (std::size_t i = 0; i < rays.size(); ++i) {
            missed += hits[i].IsHit() ? 0 : 1;
            near += hits[i].t < 0.2 ? 1 : 0;
            wrong += counts[i] == 1 ? 0 : 1;
          }
          EXPECT_EQ(missed, 0u) << Name(precision) << ", " << scale << ", " << float_rows;
          EXPECT_EQ(near, 0u) << Name(precision) << ", " << scale << ", " << float_rows;
          EXPECT_EQ(wrong, 0u) << Name(precision) << ", " << scale << ", " << float_rows;
        }
      }
    }
  }
}

TEST(N16Auto, SegmentsBetweenTwoPointsOfAConvexSurfaceMeetNothing) {
  auto engine = RandomEngine(2206);
  for (const MeshData& data : {RoundToFloat(IcoSphere({0, 0, 0}, 1, 3)), Cube({0.1, 0.2, 0.3}, 1),
                               IcoSphere({448'251.25, 5'411'932.5, 122.75}, 10, 3)}) {
    const Scene scene = MakeScene(data, BuildKind::kKdSah);
    // As answers' points: the triangle's point with weights u and v, in double.
    const auto point = [&] {
      const TriangleIndices& t = data.triangles[engine() % data.triangles.size()];
      double u = Uniform(engine, 0, 1), v = Uniform(engine, 0, 1);
      if (u + v > 1) u = 1 - u, v = 1 - v;
      if (engine() % 4 == 0) return data.vertices[t[engine() % 3]];
      return data.vertices[t[0]] * (1 - u - v) + data.vertices[t[1]] * u + data.vertices[t[2]] * v;
    };
    std::vector<Ray> segments;
    std::vector<RayF> floats;
    while (segments.size() < 10'000) {
      const Vec3d from = point(), to = point();
      const Vec3f narrow(from);
      const RayF ray{narrow, 0, Vec3f(to) - narrow, INFINITY};
      if (!IsValid(RayTo(from, to)) || !IsValid(ray)) continue;
      segments.push_back(RayTo(from, to));
      floats.push_back(ray);
    }
    for (const Precision precision : kAllPrecisions) {
      for (const bool float_rows : {false, true}) {
        TraceOptions way = With(precision);
        way.starts_on_surface = way.ends_on_surface = true;
        way.surface_offset = SurfaceOffset(*scene.mesh, precision, float_rows);
        const RayBatch rays = float_rows ? RayBatch(std::span<const RayF>(floats))
                                         : RayBatch(std::span<const Ray>(segments));
        std::vector<std::uint8_t> occluded(rays.size());
        ASSERT_TRUE(TraceAny(scene, rays, way, occluded).ok());
        EXPECT_EQ(std::count(occluded.begin(), occluded.end(), 1), 0)
            << Name(precision) << (float_rows ? ", floats" : ", doubles");
      }
    }
  }
}

}  // namespace
}  // namespace kdray::test
