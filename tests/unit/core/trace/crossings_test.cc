// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "core/trace/trace.h"
#include "tests/support/rationals.h"
#include "tests/support/seed.h"
#include "tests/support/shapes.h"

namespace kdray::core {
namespace {

const TraceOptions kExact{Precision::kExact, {}};

Scene SceneOf(const MeshData& data, BuildKind build) {
  auto mesh = std::make_shared<const TriangleMesh>(TriangleMesh::Create(data).value());
  auto tree = std::make_shared<const Tree>(BuildTree(*mesh, build).value());
  return {mesh, tree};
}

std::vector<std::uint32_t> Counts(const Scene& scene, const std::vector<Ray>& rays) {
  std::vector<std::uint32_t> counts(rays.size());
  EXPECT_TRUE(TraceCount(scene, std::span<const Ray>(rays), kExact, counts).ok());
  return counts;
}

/// From each point of a 5 x 5 x 5 lattice to each other.
std::vector<Ray> LatticeRays() {
  const auto point = [](int i) { return Vec3d{double(i % 5), double(i / 5 % 5), double(i / 25)}; };
  std::vector<Ray> rays;
  for (int a = 0; a < 125; ++a) {
    for (int b = 0; b < 125; ++b) {
      if (a == b) continue;
      Ray ray;
      ray.origin = point(a);
      ray.direction = point(b) - point(a);
      if (b % 3 == 0) ray.t_max = 1;
      if (b % 7 == 0) ray.t_min = -1;
      rays.push_back(ray);
    }
  }
  return rays;
}

/// Two cubes and a tetrahedron with corners on the lattice.
MeshData LatticeSolids() {
  MeshData tetrahedron;
  tetrahedron.vertices = {{0, 1, 4}, {3, 0, 2}, {4, 4, 3}, {1, 3, 0}};
  tetrahedron.triangles = {{0, 1, 2}, {0, 2, 3}, {0, 3, 1}, {1, 3, 2}};
  return test::Join(test::Join(test::Cube({2, 2, 2}, 1), test::Cube({2, 2, 3}, 2)), tetrahedron);
}

TEST(Crossings, AreThoseOfARayMovedByLittleInRationalNumbers) {
  const MeshData data = LatticeSolids();
  const Scene scene = SceneOf(data, BuildKind::kKdSah);
  const std::vector<Ray> rays = LatticeRays();
  const std::vector<std::uint32_t> counts = Counts(scene, rays);
  const mpq_class e = mpq_class(0x1p-60);
  std::size_t crossings = 0;
  for (std::size_t i = 0; i < rays.size(); i += 5) {
    ASSERT_EQ(counts[i], test::RationalCrossings(data, rays[i], e)) << "ray " << i;
    crossings += counts[i];
  }
  EXPECT_GT(crossings, 2'000u);
}

TEST(Crossings, AreAnEvenNumberAlongAWholeLine) {
  const Scene scene = SceneOf(LatticeSolids(), BuildKind::kKdMedian);
  std::vector<Ray> lines = LatticeRays();
  for (Ray& line : lines) {
    line.t_min = -100;
    line.t_max = 100;
  }
  const std::vector<std::uint32_t> counts = Counts(scene, lines);
  for (std::size_t i = 0; i < lines.size(); ++i) ASSERT_EQ(counts[i] % 2, 0u) << "line " << i;
}

TEST(Crossings, AreOneThroughASharedEdgeOrCornerAndNoneOrTwoWhereARayOnlyTouches) {
  const Scene scene = SceneOf(test::Cube({0, 0, 0}, 1), BuildKind::kBox);
  const auto count = [&](const Vec3d& origin, const Vec3d& direction) {
    Ray ray;
    ray.origin = origin;
    ray.direction = direction;
    return Counts(scene, {ray})[0];
  };
  EXPECT_EQ(count({0, 0, 0}, {1, 1, 1}), 1u) << "corner";
  EXPECT_EQ(count({0, 0, 0}, {1, 1, 0}), 1u) << "edge";
  EXPECT_EQ(count({0, 0, 0}, {1, 0, 0}), 1u) << "diagonal of a side";
  EXPECT_EQ(count({-2, -2, -2}, {1, 1, 1}), 2u) << "corner to corner";
  for (const double side : {-1.0, 1.0}) {
    EXPECT_EQ(count({0, 2 * side, -side}, {side, 0, 0}) % 2, 0u) << "passes by";
    EXPECT_EQ(count({-5, side, 0}, {1, 0, 0}) % 2, 0u) << "in a side";
    EXPECT_EQ(count({-5, side, side}, {1, 0, 0}) % 2, 0u) << "along an edge";
    EXPECT_EQ(count({2 * side, 0, 0}, {-side, 1, 0}) % 2, 0u) << "touches an edge";
    EXPECT_EQ(count({3 * side, 0, 0}, {-side, 0.5, 0.5}) % 2, 0u) << "touches a corner";
  }
}

TEST(Crossings, AreTheSameForEveryBuildAndEachTriangleIsThereOnce) {
  auto engine = test::RandomEngine(2100);
  const MeshData data = test::Join(test::Soup(400, 0.4, 5), test::Coincident(20));
  std::vector<Ray> rays;
  std::uniform_real_distribution<double> uniform(0, 1);
  while (rays.size() < 600) {
    Ray ray;
    ray.origin = {uniform(engine), uniform(engine), uniform(engine)};
    const Vec3d target = rays.size() % 2 ? data.vertices[engine() % data.vertices.size()]
                                         : Vec3d{uniform(engine), uniform(engine), uniform(engine)};
    ray.direction = target - ray.origin;
    rays.push_back(ray);
  }
  const std::span<const Ray> batch(rays);
  const AllHits expected =
      TraceAll(SceneOf(data, BuildKind::kBox), batch, kExact, 1'000'000).value();
  EXPECT_TRUE(expected.truncated.empty());
  for (std::size_t i = 0; i < rays.size(); ++i) {
    std::vector<PrimitiveId> ids;
    for (std::size_t k = expected.first[i]; k < expected.first[i + 1]; ++k) {
      const Hit& hit = expected.hits[k];
      ids.push_back(hit.primitive_id);
      if (k > expected.first[i]) {
        ASSERT_TRUE(Closer(expected.hits[k - 1].t, expected.hits[k - 1].primitive_id, hit.t,
                           hit.primitive_id));
      }
    }
    std::sort(ids.begin(), ids.end());
    ASSERT_EQ(std::adjacent_find(ids.begin(), ids.end()), ids.end());
  }
  for (const BuildKind build : kAllBuildKinds) {
    const Scene scene = SceneOf(data, build);
    const AllHits all = TraceAll(scene, batch, kExact, 1'000'000).value();
    EXPECT_EQ(all.hits, expected.hits) << Name(build);
    EXPECT_EQ(all.first, expected.first) << Name(build);
    const AllHits few = TraceAll(scene, batch, kExact, 3).value();
    const std::vector<std::uint32_t> counts = Counts(scene, rays);
    std::size_t cut = 0;
    for (std::size_t i = 0; i < rays.size(); ++i) {
      ASSERT_EQ(counts[i], expected.first[i + 1] - expected.first[i]);
      const std::size_t kept = few.first[i + 1] - few.first[i];
      ASSERT_EQ(kept, std::min<std::size_t>(counts[i], 3));
      for (std::size_t k = 0; k < kept; ++k)
        ASSERT_EQ(few.hits[few.first[i] + k], expected.hits[expected.first[i] + k]);
      if (counts[i] > 3) {
        ASSERT_EQ(few.truncated[cut++], i);
      }
    }
    EXPECT_EQ(cut, few.truncated.size());
  }
}

TEST(Crossings, FirstIsTheClosestHitAwayFromEdges) {
  auto engine = test::RandomEngine(2101);
  const Scene scene = SceneOf(test::Soup(300, 0.5, 6), BuildKind::kBvh);
  std::uniform_real_distribution<double> uniform(0, 1);
  std::vector<Ray> rays(3'000);
  for (Ray& ray : rays) {
    ray.origin = {uniform(engine), uniform(engine), uniform(engine)};
    ray.direction = Vec3d{uniform(engine), uniform(engine), uniform(engine)} - ray.origin;
    ray.t_max = 1;
  }
  std::vector<Hit> hits(rays.size());
  ASSERT_TRUE(TraceClosest(scene, std::span<const Ray>(rays), {Precision::kExact, {}}, hits).ok());
  const AllHits nearest = TraceAll(scene, std::span<const Ray>(rays), kExact, 1).value();
  for (std::size_t i = 0; i < rays.size(); ++i) {
    ASSERT_EQ(nearest.first[i + 1] > nearest.first[i], hits[i].IsHit());
    if (hits[i].IsHit()) {
      ASSERT_EQ(nearest.hits[nearest.first[i]], hits[i]);
    }
  }
}

TEST(Crossings, OfRaysThatCannotBeAreNone) {
  const Scene scene = SceneOf(test::Cube({0, 0, 0}, 1), BuildKind::kBox);
  std::vector<Ray> rays(3);
  rays[0].direction = {1, 0, 0};
  rays[1].direction = {0, 0, 0};
  rays[2].direction = {0, NAN, 1};
  EXPECT_EQ(Counts(scene, rays), (std::vector<std::uint32_t>{1, 0, 0}));
  const AllHits all = TraceAll(scene, std::span<const Ray>(rays), kExact, 8).value();
  EXPECT_EQ(all.first, (std::vector<std::size_t>{0, 1, 1, 1}));
}

TEST(Crossings, StopWhenCancelled) {
  const Scene scene = SceneOf(test::Cube({0, 0, 0}, 1), BuildKind::kBox);
  const CancelToken cancel = CancelToken::Cancellable();
  cancel.Cancel();
  const std::vector<Ray> rays(10);
  std::vector<std::uint32_t> counts(10);
  EXPECT_EQ(TraceCount(scene, std::span<const Ray>(rays), {Precision::kExact, cancel}, counts)
                .error()
                .code,
            ErrorCode::kCancelled);
  EXPECT_EQ(
      TraceAll(scene, std::span<const Ray>(rays), {Precision::kExact, cancel}, 1).error().code,
      ErrorCode::kCancelled);
}

// Beyond some 2^50 mesh sizes a ray's place beside the mesh is lost in rounding, so trees may cull
// nothing that the exact test accepts.
TEST(TraceClosest, ExactAnswersAsRationalNumbersFromAnyDistance) {
  auto engine = test::RandomEngine(2102);
  const MeshData data = test::Join(test::Cube({0, 0, 0}, 0.75), test::Cube({0, 0, 0}, 0.5));
  std::vector<Scene> scenes;
  for (const BuildKind build : kAllBuildKinds) scenes.push_back(SceneOf(data, build));
  const auto integer = [&] { return static_cast<double>(static_cast<int>(engine() % 1999) - 999); };
  int hits = 0;
  for (int k = 3; k <= 300; k += k < 70 ? 1 : 23) {
    for (int i = 0; i < 8; ++i) {
      Ray ray;
      ray.direction = {integer(), integer(), integer()};
      ray.origin = -ray.direction * std::ldexp(1, k);  // goes through the middle
      if (i % 2 != 0) {
        const int axis = static_cast<int>(engine() % 3);
        ray.direction[axis] = 0;
        ray.origin[axis] = 0.25 * static_cast<double>(engine() % 5);
      }
      if (!IsValid(ray)) continue;
      const test::RationalClosestHit want = test::RationalClosest(data, ray);
      hits += want.primitive_id != kNoPrimitive ? 1 : 0;
      for (const Scene& scene : scenes) {
        const Hit hit = ClosestHit(scene, ray, Precision::kExact);
        ASSERT_EQ(hit.primitive_id, want.primitive_id)
            << "2^" << k << ", " << Name(scene.tree->build);
        if (hit.IsHit()) {
          ASSERT_EQ(hit.t, test::RoundedToNearest(want.t));
        }
      }
    }
  }
  EXPECT_GT(hits, 300);
}

// A weight of a corner that the ray does not lean on is 0, and never -0, which a text would show.
TEST(TraceClosest, GivesNoNegativeZeroWeights) {
  const Scene scene = SceneOf(LatticeSolids(), BuildKind::kKdSah);
  const std::vector<Ray> rays = LatticeRays();
  for (const Precision precision : kAllPrecisions) {
    std::vector<Hit> hits(rays.size());
    ASSERT_TRUE(TraceClosest(scene, std::span<const Ray>(rays), {precision, {}}, hits).ok());
    std::size_t zeros = 0;
    for (const Hit& hit : hits) {
      ASSERT_FALSE(hit.u == 0 && std::signbit(hit.u)) << Name(precision);
      ASSERT_FALSE(hit.v == 0 && std::signbit(hit.v)) << Name(precision);
      ASSERT_FALSE(hit.t == 0 && std::signbit(hit.t)) << Name(precision);
      zeros += hit.IsHit() && (hit.u == 0 || hit.v == 0);
    }
    EXPECT_GT(zeros, 100u);
  }
}

}  // namespace
}  // namespace kdray::core
