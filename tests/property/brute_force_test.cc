// SPDX-License-Identifier: Apache-2.0
// Trees answer what brute force answers, bit for bit: on random scenes, exhaustive small ones, and
// where rays, planes and triangles meet in degenerate ways (N07 to N11 of the numeric catalogue).
#include "core/trace/brute_force.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "core/trace/trace.h"
#include "tests/property/scenes.h"
#include "tests/support/seed.h"
#include "tests/support/shapes.h"

namespace kdray::test {
namespace {

using namespace core;

const std::vector<Precision> kAll(kAllPrecisions.begin(), kAllPrecisions.end());
const std::vector<Precision> kRounded = {Precision::kFast, Precision::kWatertight,
                                         Precision::kDouble};

/// All rays in the rounded precisions, every twentieth in `exact`, which decides degenerate cases
/// with long integers.
void ExpectAllPrecisionsSame(const MeshData& data, std::vector<Ray> rays) {
  ExpectSameAsBruteForce(data, rays, kRounded);
  std::vector<Ray> some;
  for (std::size_t i = 0; i < rays.size(); i += 20) some.push_back(rays[i]);
  ExpectSameAsBruteForce(data, some, {Precision::kExact});
}

Bounds3d BoundsOf(const MeshData& data) {
  Bounds3d bounds = Bounds3d::Empty();
  for (const TriangleIndices& t : data.triangles) {
    for (const std::uint32_t v : t) bounds.Extend(data.vertices[v]);
  }
  return bounds;
}

/// Axis-parallel rays whose other coordinates are copied from vertices, with zeros of both signs.
std::vector<Ray> AxisParallelRays(const MeshData& data, std::size_t count,
                                  std::mt19937_64& engine) {
  const Bounds3d bounds = BoundsOf(data);
  std::vector<Ray> rays;
  while (rays.size() < count) {
    const auto vertex = [&] {
      return data.vertices[data.triangles[engine() % data.triangles.size()][engine() % 3]];
    };
    Ray ray;
    ray.origin = {vertex().x, vertex().y, vertex().z};
    const int axis = static_cast<int>(engine() % 3);
    for (int k = 0; k < 3; ++k) ray.direction[k] = engine() % 2 ? 0.0 : -0.0;
    ray.direction[axis] = engine() % 2 ? 1.0 : -1.0;
    if (engine() % 2)
      ray.origin[axis] = ray.direction[axis] > 0 ? bounds.min[axis] - 1 : bounds.max[axis] + 1;
    rays.push_back(ray);
  }
  return rays;
}

TEST(BruteForce, AgreesOnRandomSoups) {
  for (const std::size_t count : {1u, 2u, 3u, 8u, 9u, 40u, 300u}) {
    auto engine = RandomEngine(100 + count);
    const MeshData soup = Soup(count, count < 10 ? 0.8 : 0.2, count);
    ExpectSameAsBruteForce(soup, RandomRays(BoundsOf(soup), 3000, engine), kAll);
    if (HasFatalFailure()) return;
  }
}

TEST(BruteForce, AgreesOnEveryRayOfASmallWorld) {
  // All rays from each point of a 4 x 4 x 4 lattice to each other, over triangles with corners on
  // it: planes, edges and corners are met in every way there is.
  MeshData data = Cube({1.5, 1.5, 1.5}, 0.5);
  data = Join(data, Cube({2, 2, 2}, 1));
  std::vector<Ray> rays;
  for (int a = 0; a < 64; ++a) {
    for (int b = 0; b < 64; ++b) {
      if (a == b) continue;
      const auto point = [](int i) {
        return Vec3d{double(i % 4), double(i / 4 % 4), double(i / 16)};
      };
      rays.push_back(RayTo(point(a), point(b)));
      if (b % 3 == 0) rays.back().t_max = 1;
    }
  }
  ExpectAllPrecisionsSame(data, rays);
}

TEST(N07AxisParallel, AxisParallelRaysThroughVerticesAgreeWithBruteForce) {
  auto engine = RandomEngine(7);
  for (const MeshData& data :
       {Cube({0, 0, 0}, 1), RoundToFloat(UvSphere({0, 0, 0}, 1, 8, 12)), Grid(6, 1, 0.5)}) {
    ExpectAllPrecisionsSame(data, AxisParallelRays(data, 34'000, engine));
    if (HasFatalFailure()) return;
  }
}

TEST(N08OriginsOnPlanes, OriginsOnPlanesFacesVerticesAndTrianglesAgreeWithBruteForce) {
  auto engine = RandomEngine(9);
  const MeshData data = RoundToFloat(BumpySphere({0, 0, 0}, 1, 10, 16, 0.3));
  const Bounds3d bounds = BoundsOf(data);
  std::vector<Vec3d> planes;  // a coordinate per axis that some tree splits at
  for (const Scene& scene : MakeScenes(data)) {
    if (const auto* tree = std::get_if<KdTree>(scene.tree->Binary(*scene.mesh)->get())) {
      for (const KdNode& node : tree->nodes) {
        if (node.IsLeaf()) continue;
        Vec3d at = scene.mesh->frame().ToLocal(PointIn(bounds, engine));
        at[node.axis()] = static_cast<double>(node.split());
        planes.push_back(scene.mesh->frame().ToWorld(at));
      }
    }
  }
  ASSERT_GT(planes.size(), 100u);
  std::vector<Ray> rays;
  while (rays.size() < 100'000) {
    const TriangleIndices& t = data.triangles[engine() % data.triangles.size()];
    Vec3d origin;
    switch (rays.size() % 4) {
      case 0:
        origin = planes[engine() % planes.size()];
        break;
      case 1:
        origin = PointIn(bounds, engine);
        origin[static_cast<int>(engine() % 3)] = engine() % 2 ? bounds.min.x : bounds.max.x;
        break;
      case 2:
        origin = data.vertices[t[engine() % 3]];
        break;
      default: {
        const double u = Uniform(engine, 0, 0.5), v = Uniform(engine, 0, 0.5);
        origin =
            data.vertices[t[0]] * (1 - u - v) + data.vertices[t[1]] * u + data.vertices[t[2]] * v;
      }
    }
    Ray ray = RayTo(origin, PointIn(bounds, engine));
    if (rays.size() % 3 == 0) {
      const int axis = static_cast<int>(engine() % 3);
      ray.direction = {};
      ray.direction[axis] = 1;
    } else if (rays.size() % 3 == 1) {
      ray.direction[static_cast<int>(engine() % 3)] = 0;
    }
    if (IsValid(ray)) rays.push_back(ray);
  }
  ExpectAllPrecisionsSame(data, rays);
}

TEST(N09FlatMeshes, FlatAndTinyMeshesAgreeWithBruteForce) {
  auto engine = RandomEngine(10);
  MeshData one = Coincident(1);
  MeshData in_plane = Join(Grid(3, 0, 0.5), Join(Grid(3, 1, 0.5), Grid(3, 2, 0.5)));
  for (const MeshData& data : {one, Coincident(40), Cube({0.5, 0.5, 0.5}, 0.5), Grid(4, 0, 0.25),
                               Grid(4, 1, 0.25), Grid(4, 2, 0.25), in_plane}) {
    Bounds3d around = BoundsOf(data);
    around.min = around.min - Vec3d{0.5, 0.5, 0.5};
    around.max = around.max + Vec3d{0.5, 0.5, 0.5};
    std::vector<Ray> rays = RandomRays(around, 5'000, engine);
    for (const Ray& ray : RaysAtVertices(data, PointIn(around, engine), 2'000)) rays.push_back(ray);
    for (const Ray& ray : RaysOnEdges(data, PointIn(around, engine), 2'000, engine))
      rays.push_back(ray);
    for (const Ray& ray : AxisParallelRays(data, 6'000, engine)) rays.push_back(ray);
    ExpectAllPrecisionsSame(data, rays);
    if (HasFatalFailure()) return;
  }
}

TEST(N10ExtremeDirections, ExtremeDirectionsAgreeWithBruteForceAndScaleT) {
  auto engine = RandomEngine(11);
  const MeshData data = RoundToFloat(UvSphere({0, 0, 0}, 1, 8, 12));
  std::vector<Ray> rays;
  while (rays.size() < 20'000) {
    Ray ray = RayTo(PointIn(BoundsOf(data), engine), PointIn(BoundsOf(data), engine));
    constexpr double kOdd[] = {0.0, -0.0, 5e-324, -1e-310, 1e-40, 1e38, -1e38, 1e300};
    ray.direction[static_cast<int>(engine() % 3)] = kOdd[engine() % std::size(kOdd)];
    if (engine() % 2)
      ray.direction[static_cast<int>(engine() % 3)] = kOdd[engine() % std::size(kOdd)];
    if (IsValid(ray)) rays.push_back(ray);
  }
  ExpectSameAsBruteForce(data, rays,
                         {Precision::kFast, Precision::kWatertight, Precision::kDouble});
  rays.resize(2'000);
  ExpectSameAsBruteForce(data, rays, {Precision::kExact});

  const Scene scene = MakeScene(data, BuildKind::kKdSah);
  for (int i = 0; i < 500; ++i) {
    const Ray ray = RayTo(PointIn(BoundsOf(data), engine), PointIn(BoundsOf(data), engine));
    for (const Precision precision : kAll) {
      const Hit hit = ClosestHit(scene, ray, precision);
      for (const int k : {-66, -20, 20, 66}) {
        Ray longer = ray;
        for (int axis = 0; axis < 3; ++axis)
          longer.direction[axis] = std::ldexp(ray.direction[axis], k);
        const Hit scaled = ClosestHit(scene, longer, precision);
        ASSERT_EQ(scaled.primitive_id, hit.primitive_id);
        if (hit.IsHit()) {
          ASSERT_EQ(scaled.t, std::ldexp(hit.t, -k));
        }
      }
    }
  }
}

TEST(N10ExtremeDirections, AHitWhoseTNoDoubleHoldsHasTheLargestFiniteOne) {
  constexpr double kMost = std::numeric_limits<double>::max();
  MeshData data;
  data.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  data.triangles = {{0, 1, 2}};
  const Scene scene = MakeScene(data, BuildKind::kBox);
  std::vector<Ray> rays;
  std::vector<double> want;
  const auto add = [&](double z, double dz, double t_min, double t_max, double t) {
    Ray ray;
    ray.origin = {0.2, 0.2, z};
    ray.direction = {0, 0, dz};
    ray.t_min = t_min;
    ray.t_max = t_max;
    rays.push_back(ray);
    want.push_back(t);
  };
  constexpr double kInf = std::numeric_limits<double>::infinity();
  for (const double dz : {-0x1p-1074, -0x1p-1060, -0x1p-1025}) {
    add(1, dz, 0, kInf, kMost);
    add(1, dz, 0, kMost, kMost);      // the t just answered finds the hit again
    add(1, dz, kMost, kMost, kMost);  // as the first end too
    add(1, dz, 0, 0x1.fffffffffffffp1022, kInf);
    add(1, dz, kInf, kInf, kInf);  // a miss: no answer is infinite
    add(-1, dz, -kInf, 0, -kMost);
    add(-1, dz, -kMost, 0, -kMost);
  }
  // t rounds to -0, which the interval holds and which is answered without its sign.
  add(0x1p-1000, 0x1p100, -1, 1, 0);
  for (const Precision precision : kAllPrecisions) {
    for (const TraceOptions& way : WaysToTrace(precision)) {
      std::vector<Hit> hits(rays.size());
      std::vector<std::uint8_t> occluded(rays.size());
      ASSERT_TRUE(TraceClosest(scene, std::span<const Ray>(rays), way, hits).ok());
      ASSERT_TRUE(TraceAny(scene, std::span<const Ray>(rays), way, occluded).ok());
      for (std::size_t i = 0; i < rays.size(); ++i) {
        EXPECT_EQ(hits[i].t, want[i]) << Name(precision) << ", ray " << i;
        EXPECT_EQ(hits[i].IsHit(), want[i] != kInf) << Name(precision) << ", ray " << i;
        EXPECT_FALSE(std::signbit(hits[i].t) && hits[i].t == 0) << Name(precision) << ", ray " << i;
        EXPECT_EQ(occluded[i] != 0, want[i] != kInf) << Name(precision) << ", ray " << i;
        const Hit brute = BruteForceClosest(*scene.mesh, rays[i], precision);
        EXPECT_EQ(brute.t, want[i]) << Name(precision) << ", ray " << i;
      }
    }
  }
}

TEST(N11InvalidRays, RaysThatCannotBeAreMissesAndSpoilNoNeighbour) {
  auto engine = RandomEngine(12);
  const MeshData data = RoundToFloat(UvSphere({0, 0, 0}, 1, 8, 12));
  constexpr double kInf = std::numeric_limits<double>::infinity();
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  const Scene scene = MakeScene(data, BuildKind::kKdSah);
  const std::vector<Ray> good = RandomRays(BoundsOf(data), 10'000, engine);
  std::vector<Ray> mixed = good;
  std::vector<bool> spoilt(mixed.size());
  for (std::size_t i = 0; i < mixed.size(); i += 3) {
    spoilt[i] = true;
    Ray& ray = mixed[i];
    switch (i / 3 % 7) {
      case 0:
        ray.origin.y = kNan;
        break;
      case 1:
        ray.origin.x = -kInf;
        break;
      case 2:
        ray.direction.z = kNan;
        break;
      case 3:
        ray.direction.x = kInf;
        break;
      case 4:
        ray.direction = {0, -0.0, 0};
        break;
      case 5:
        ray.t_min = kNan;
        break;
      default:
        ray.t_min = 2, ray.t_max = 1;
    }
  }
  std::vector<Hit> expected(good.size()), hits(good.size());
  std::vector<std::uint8_t> occluded(good.size());
  ASSERT_TRUE(TraceClosest(scene, std::span<const Ray>(good), {}, expected).ok());
  ASSERT_TRUE(TraceClosest(scene, std::span<const Ray>(mixed), {}, hits).ok());
  ASSERT_TRUE(TraceAny(scene, std::span<const Ray>(mixed), {}, occluded).ok());
  for (std::size_t i = 0; i < mixed.size(); ++i) {
    if (spoilt[i]) {
      EXPECT_FALSE(hits[i].IsHit());
      EXPECT_TRUE(std::isnan(hits[i].t));
      EXPECT_EQ(occluded[i], 0);
    } else {
      EXPECT_EQ(hits[i], expected[i]);
    }
  }
}

TEST(Trace, FloatRaysAnswerAsTheSameRaysInDouble) {
  auto engine = RandomEngine(13);
  const MeshData data = RoundToFloat(UvSphere({0, 0, 0}, 1, 16, 24));
  const Scene scene = MakeScene(data, BuildKind::kKdSah);
  std::vector<RayF> floats;
  std::vector<Ray> doubles;
  for (const Ray& ray : RandomRays(BoundsOf(data), 10'000, engine)) {
    const RayF narrow{Vec3f(ray.origin), 0.25f, Vec3f(ray.direction), 1.5f};
    floats.push_back(narrow);
    doubles.push_back({Vec3d(narrow.origin), 0.25, Vec3d(narrow.direction), 1.5});
  }
  std::vector<Hit> from_floats(floats.size()), from_doubles(floats.size());
  ASSERT_TRUE(TraceClosest(scene, std::span<const RayF>(floats), {}, from_floats).ok());
  ASSERT_TRUE(TraceClosest(scene, std::span<const Ray>(doubles), {}, from_doubles).ok());
  EXPECT_EQ(from_floats, from_doubles);
}

TEST(Trace, StopsWhenCancelledOrLate) {
  const MeshData data = Soup(20'000, 0.05, 1);
  const Scene scene = MakeScene(data, BuildKind::kBox);
  auto engine = RandomEngine(14);
  const std::vector<Ray> rays =
      RandomRays(BoundsOf(data), 100'000, engine);  // minutes of work in a box
  std::vector<Hit> hits(rays.size());
  TraceOptions options;
  options.cancel = CancelToken::Cancellable();
  options.cancel.Cancel();
  const Status cancelled = TraceClosest(scene, std::span<const Ray>(rays), options, hits);
  ASSERT_FALSE(cancelled.ok());
  EXPECT_EQ(cancelled.error().code, ErrorCode::kCancelled);
  options.cancel =
      CancelToken::WithDeadline(CancelToken::Clock::now() + std::chrono::milliseconds(20));
  const Status late = TraceClosest(scene, std::span<const Ray>(rays), options, hits);
  ASSERT_FALSE(late.ok());
  EXPECT_EQ(late.error().code, ErrorCode::kDeadlineExceeded);
}

TEST(Trace, CountsTheWorkWithoutChangingTheAnswer) {
  const MeshData data = RoundToFloat(UvSphere({0, 0, 0}, 1, 32, 64));
  auto engine = RandomEngine(15);
  const std::vector<Ray> rays = RandomRays(BoundsOf(data), 2'000, engine);
  std::uint64_t box_tests = 0, tree_tests = 0;
  for (const BuildKind build : {BuildKind::kBox, BuildKind::kKdSah}) {
    const Scene scene = MakeScene(data, build);
    std::vector<Hit> hits(rays.size()), counted(rays.size());
    std::vector<TraceCost> costs(rays.size());
    ASSERT_TRUE(TraceClosest(scene, std::span<const Ray>(rays), {}, hits).ok());
    ASSERT_TRUE(TraceCostly(scene, std::span<const Ray>(rays), {}, counted, costs).ok());
    EXPECT_EQ(hits, counted);
    for (const TraceCost& cost : costs)
      (build == BuildKind::kBox ? box_tests : tree_tests) += cost.triangles_tested;
  }
  EXPECT_LT(tree_tests * 50, box_tests);
}

// A plain Moeller-Trumbore in double, straight from the paper, on world coordinates: an oracle that
// shares nothing with the leaf tests. It knows nothing of edges, so rays near them are left out.
struct PlainHit {
  double t = std::numeric_limits<double>::infinity();
  PrimitiveId id = kNoPrimitive;
  bool near_edge = false;
};
PlainHit PlainClosest(const MeshData& data, const Ray& ray) {
  PlainHit best;
  for (PrimitiveId id = 0; id < data.triangles.size(); ++id) {
    const auto [a, b, c] = data.triangles[id];
    const Vec3d ab = data.vertices[b] - data.vertices[a], ac = data.vertices[c] - data.vertices[a];
    const Vec3d p = Cross(ray.direction, ac);
    const double determinant = Dot(ab, p);
    if (determinant == 0) continue;
    const Vec3d s = ray.origin - data.vertices[a];
    const double u = Dot(s, p) / determinant, v = Dot(ray.direction, Cross(s, ab)) / determinant;
    const double edge = std::min({u, v, 1 - u - v});
    if (std::fabs(edge) < 1e-4) best.near_edge = true;
    const double t = Dot(ac, Cross(s, ab)) / determinant;
    if (edge < 0 || t < ray.t_min || t > ray.t_max || t >= best.t) continue;
    best.t = t;
    best.id = id;
  }
  return best;
}

TEST(BruteForce, AgreesWithAPlainTestAwayFromEdges) {
  auto engine = RandomEngine(16);
  for (const MeshData& data :
       {RoundToFloat(Soup(200, 0.3, 77)), RoundToFloat(BumpySphere({10, 20, 30}, 3, 16, 24, 0.4)),
        Cube({-5, 0, 5}, 2)}) {
    const Scene scene = MakeScene(data, BuildKind::kKdSah);
    int compared = 0;
    for (const Ray& ray : RandomRays(BoundsOf(data), 15'000, engine)) {
      const PlainHit want = PlainClosest(data, ray);
      if (want.near_edge) continue;
      ++compared;
      for (const Precision precision : kAll) {
        const Hit hit = ClosestHit(scene, ray, precision);
        // The float tests may take a ray for one that passes a few 2^-24 of the mesh's distance
        // from the origin beside it.
        const double tolerance = precision == Precision::kFast         ? 2e-3
                                 : precision == Precision::kWatertight ? 1e-5
                                                                       : 1e-9;
        ASSERT_EQ(hit.primitive_id, want.id) << Name(precision);
        if (hit.IsHit()) {
          ASSERT_NEAR(hit.t, want.t, tolerance * (1 + want.t)) << Name(precision);
        }
      }
    }
    EXPECT_GT(compared, 10'000);
  }
}

}  // namespace
}  // namespace kdray::test
