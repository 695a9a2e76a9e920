// SPDX-License-Identifier: Apache-2.0
#include "core/tradeoff/tradeoff.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>

#include "core/base/parallel.h"
#include "core/geometry/mesh_health.h"
#include "core/trace/trace.h"
#include "core/tradeoff/accuracy_judge.h"
#include "core/tradeoff/ray_sets.h"
#include "core/tradeoff/speed_meter.h"
#include "tests/support/shapes.h"

namespace kdray::core {
namespace {

using testing::Each;
using testing::ElementsAreArray;
using testing::Gt;

std::shared_ptr<const TriangleMesh> MakeMesh(const MeshData& data) {
  return std::make_shared<const TriangleMesh>(*TriangleMesh::Create(data));
}

Scene MakeScene(const MeshData& data, BuildKind build = BuildKind::kKdSah) {
  auto mesh = MakeMesh(data);
  auto tree = std::make_shared<const Tree>(*BuildTree(*mesh, build));
  return {mesh, tree};
}

TradeoffOptions Quick() {
  TradeoffOptions options;
  options.rays = 4096;
  options.runs = 2;
  options.trace_time = std::chrono::milliseconds(200);
  return options;
}

Tradeoff Measure(const MeshData& data, bool closed, const TradeoffOptions& options = Quick()) {
  Result<Tradeoff> measured = MeasureTradeoff(MakeMesh(data), closed, options, {});
  EXPECT_TRUE(measured.ok()) << measured.error().message;
  return measured.ok() ? *measured : Tradeoff{};
}

const Accuracy& Of(const Tradeoff& tradeoff, Precision precision) {
  return *std::find_if(tradeoff.precisions.begin(), tradeoff.precisions.end(),
                       [&](const Accuracy& a) { return a.precision == precision; });
}

TEST(ErrorRates, ShowWhatAZeroMeans) {
  EXPECT_EQ((ErrorRate{0, 300}.bound()), 0.01);
  EXPECT_EQ((ErrorRate{0, 0}.bound()), 1.0);
  EXPECT_EQ((ErrorRate{1, 300}.bound()), std::nullopt);
  EXPECT_EQ((ErrorRate{3, 300}.rate()), 0.01);
}

TEST(Tradeoff, OfACubeHasNoLeakButInFast) {
  const Tradeoff cube = Measure(test::Cube({0.1, -0.2, 0.3}, 0.7), true);
  EXPECT_TRUE(cube.from_inside);
  ASSERT_EQ(cube.precisions.size(), 4u);
  for (const Precision precision :
       {Precision::kWatertight, Precision::kDouble, Precision::kExact}) {
    const Accuracy& accuracy = Of(cube, precision);
    ASSERT_TRUE(accuracy.leaks);
    EXPECT_EQ(accuracy.leaks->count, 0u) << Name(precision);
    EXPECT_GE(accuracy.leaks->rays, 64u);
    EXPECT_EQ(accuracy.missed_hits.count, 0u);
    EXPECT_EQ(accuracy.extra_hits.count, 0u);
    EXPECT_LE(accuracy.t_error.max, *TraitsOf(precision).t_error) << Name(precision);
  }
  // Aimed rays go through edges, where a plain float test loses some percent of them.
  EXPECT_GT(Of(cube, Precision::kFast).leaks->count, 0u);
  EXPECT_EQ(Of(cube, Precision::kFast).leaks->count, Of(cube, Precision::kFast).missed_hits.count);
}

TEST(Tradeoff, OfAMeshThatIsNotClosedSaysNothingAboutLeaks) {
  const Tradeoff grid = Measure(test::Grid(8, 2, 0.25), false);
  EXPECT_FALSE(grid.from_inside);
  for (const Accuracy& accuracy : grid.precisions) EXPECT_FALSE(accuracy.leaks);
  EXPECT_EQ(Of(grid, Precision::kExact).missed_hits.count, 0u);
  EXPECT_GT(Of(grid, Precision::kExact).t_error.rays, 0u);
}

TEST(Tradeoff, CoversEveryBuildWithEveryPrecisionAndFindsTheSameAnswers) {
  TradeoffOptions options = Quick();
  options.threads = 2;
  Tradeoff tradeoff;
  Arena(2).Run([&] {
    tradeoff = Measure(test::BumpySphere({3, 1, 2}, 2, 16, 32, 0.3), true, options);
  });
  ASSERT_EQ(tradeoff.builds.size(), kAllBuildKinds.size());
  ASSERT_EQ(tradeoff.pairs.size(), kAllBuildKinds.size() * kAllPrecisions.size());
  for (std::size_t i = 0; i < tradeoff.pairs.size(); ++i) {
    const MeasuredPair& pair = tradeoff.pairs[i];
    EXPECT_EQ(pair.build, kAllBuildKinds[i / kAllPrecisions.size()]);
    EXPECT_EQ(pair.precision, kAllPrecisions[i % kAllPrecisions.size()]);
    for (const Speed& speed : {pair.random, pair.aimed}) {
      EXPECT_GT(speed.slowest, 0);
      EXPECT_LE(speed.slowest, speed.rays_per_s);
      EXPECT_LE(speed.rays_per_s, speed.fastest);
    }
    EXPECT_EQ(pair.differences.count, 0u) << Name(pair.build) << " " << Name(pair.precision);
    EXPECT_GT(pair.differences.rays, 0u);
  }
  for (const MeasuredBuild& build : tradeoff.builds) {
    EXPECT_GT(build.build_ms, 0);
    EXPECT_GT(build.bytes, 0u);
    EXPECT_GT(build.random.nodes, 0) << Name(build.build);
    EXPECT_GT(build.aimed.triangles, 0) << Name(build.build);
  }
  // A box tests every triangle for the rays that enter it, and from inside all do.
  EXPECT_EQ(tradeoff.builds.back().aimed.triangles, static_cast<double>(tradeoff.triangles));
  EXPECT_EQ(tradeoff.runs, tradeoff.pairs.size() * 2 * 2);
  EXPECT_EQ(tradeoff.disturbed_runs, 0u);
}

TEST(Tradeoff, TellsTheRunsBesideWhichOtherWorkWent) {
  TradeoffOptions options = Quick();
  options.builds = {BuildKind::kKdSah};
  int asked = 0;
  options.is_disturbed = [&] { return asked++ < 3; };
  const Tradeoff tradeoff = Measure(test::Cube({0, 0, 0}, 1), true, options);
  EXPECT_EQ(tradeoff.disturbed_runs, 3u);
}

TEST(Tradeoff, EndsInTimeWhereARayTakesLong) {
  TradeoffOptions options = Quick();
  options.builds = {BuildKind::kBox};
  options.rays = 1 << 16;
  const auto start = std::chrono::steady_clock::now();
  const Tradeoff slow = Measure(test::IcoSphere({0, 0, 0}, 1, 5), true, options);
  // Unbounded it would be 65,536 rays at 20,480 triangles for each of four precisions.
  EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(60));
  EXPECT_LT(Of(slow, Precision::kExact).missed_hits.rays, 1u << 16);
}

TEST(Tradeoff, StopsWhenItIsCancelled) {
  const CancelToken cancel = CancelToken::Cancellable();
  TradeoffOptions options = Quick();
  options.trace_time = std::chrono::hours(1);
  options.is_disturbed = [&] {
    cancel.Cancel();
    return false;
  };
  Progress progress;
  const Result<Tradeoff> measured =
      MeasureTradeoff(MakeMesh(test::Cube({0, 0, 0}, 1)), true, options, cancel, &progress);
  ASSERT_FALSE(measured.ok());
  EXPECT_EQ(measured.error().code, ErrorCode::kCancelled);
  EXPECT_GT(progress.fraction(), 0);
  EXPECT_LT(progress.fraction(), 1);
}

TEST(Tradeoff, AccuracyDependsOnTheSeedAndNotOnTheRun) {
  TradeoffOptions options = Quick();
  options.builds = {BuildKind::kKdSah};
  options.rays = 512;
  options.trace_time = std::chrono::seconds(2);  // enough for all rays
  const MeshData data = test::BumpySphere({0, 0, 0}, 1, 10, 20, 0.2);
  const Tradeoff first = Measure(data, true, options), again = Measure(data, true, options);
  EXPECT_EQ(first.precisions, again.precisions);
  EXPECT_EQ(first.precisions[0].missed_hits.rays, 512u);
  options.seed = 2;
  EXPECT_NE(Measure(data, true, options).precisions, first.precisions);
}

TEST(AimedRays, FromInsideAClosedMeshAllHitIt) {
  const Scene scene = MakeScene(
      test::Join(test::BumpySphere({0, 0, 0}, 1, 12, 24, 0.3), test::IcoSphere({5, 0, 0}, 0.5, 2)));
  const Result<AimedRays> aimed = MakeAimedRays(scene, true, 2000, 7, {});
  ASSERT_TRUE(aimed.ok());
  ASSERT_TRUE(aimed->from_inside);
  for (const Ray& ray : aimed->rays) {
    ASSERT_TRUE(ClosestHit(scene, ray, Precision::kExact).IsHit());
    Ray backward = ray;
    backward.direction = ray.direction * -1.0;
    ASSERT_TRUE(ClosestHit(scene, backward, Precision::kExact).IsHit());
  }
}

TEST(AimedRays, StartInsideBodiesThatTouchFaceToFace) {
  // Two flat boxes: nearly every line through one crosses the common face, which is there twice.
  const auto flat_box = [](double height) {
    MeshData box = test::Cube({0, 0, 0}, 1);
    for (Vec3d& vertex : box.vertices) vertex.z = height + 0.01 * vertex.z;
    return box;
  };
  const Scene scene = MakeScene(test::Join(flat_box(0), flat_box(0.02)));
  const Result<AimedRays> aimed = MakeAimedRays(scene, true, 256, 7, {});
  ASSERT_TRUE(aimed.ok());
  EXPECT_TRUE(aimed->from_inside);
  for (const Ray& ray : aimed->rays) {
    EXPECT_LT(std::fabs(ray.origin.x), 1);
    EXPECT_LT(std::fabs(ray.origin.y), 1);
    EXPECT_LT(std::fabs(ray.origin.z - 0.01), 0.02);
  }
}

TEST(AimedRays, AtAPointLikeMeshAreStillRays) {
  MeshData data;
  data.vertices = {{2, 2, 2}, {2, 2, 2}, {2, 2, 2}};
  data.triangles = {{0, 1, 2}};
  const Scene scene = MakeScene(data);
  const Result<AimedRays> aimed = MakeAimedRays(scene, false, 64, 7, {});
  ASSERT_TRUE(aimed.ok());
  for (const Ray& ray : aimed->rays) EXPECT_TRUE(IsValid(ray));
  for (const Ray& ray : RandomRays(*scene.mesh, 64, 7)) EXPECT_TRUE(IsValid(ray));
}

class JudgeTest : public testing::Test {
 protected:
  // Two triangles of the square z = 0 that share an edge, and one apart.
  JudgeTest() {
    MeshData data;
    data.vertices = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {0, 0, 2}, {1, 0, 2}, {0, 1, 2}};
    data.triangles = {{0, 1, 2}, {0, 2, 3}, {4, 5, 6}};
    mesh_ = MakeMesh(data);
  }
  Accuracy Judge(const Hit& exact, const Hit& hit, bool from_inside = false) {
    AccuracyJudge judge(*mesh_, Precision::kFast, from_inside);
    Ray ray;
    ray.origin = {0.5, 0.5, 5};
    ray.direction = {0, 0, -2};
    judge.Add(std::span(&ray, 1), std::span(&exact, 1), std::span(&hit, 1));
    return judge.Sum();
  }
  std::shared_ptr<const TriangleMesh> mesh_;
};

TEST_F(JudgeTest, CountsANeighbourAsWrongAndComparesItsT) {
  const Accuracy a = Judge({2.5, 0.3, 0.3, 0}, {2.5 + 1e-3, 0.3, 0.3, 1});
  EXPECT_EQ(a.wrong_triangles, (ErrorRate{1, 1}));
  EXPECT_EQ(a.unconnected_triangles, (ErrorRate{0, 1}));
  // Head-on, so the cosine is 1; the mesh is 2 high, and a direction is 2 long.
  EXPECT_EQ(a.t_error.rays, 1u);
  EXPECT_NEAR(a.t_error.max, 1e-3 / (2.5 + 1), 1e-12);
  EXPECT_EQ(a.t_error.p999, a.t_error.max);
}

TEST_F(JudgeTest, TellsATriangleApartAndLeavesItsTOut) {
  const Accuracy a = Judge({1.5, 0, 0, 2}, {2.5, 0, 0, 1});
  EXPECT_EQ(a.wrong_triangles.count, 1u);
  EXPECT_EQ(a.unconnected_triangles.count, 1u);
  EXPECT_EQ(a.t_error.rays, 0u);
}

TEST_F(JudgeTest, TellsAHitPastAFoldFromAnErrorOfT) {
  // The nearer hit lies on the edge u = 0 of its triangle, the farther one shares an edge with it.
  const Accuracy fold = Judge({2.5, 0, 0.5, 0}, {3.5, 0.2, 0.2, 1});
  EXPECT_EQ(fold.folds, (ErrorRate{1, 1}));
  EXPECT_EQ(fold.t_error.rays, 0u);
  // In the middle of its triangle nothing explains it.
  const Accuracy error = Judge({2.5, 0.3, 0.3, 0}, {3.5, 0.2, 0.2, 1});
  EXPECT_EQ(error.folds.count, 0u);
  EXPECT_EQ(error.t_error.rays, 1u);
  // A tie at the edge is no fold.
  EXPECT_EQ(Judge({2.5, 0, 0.5, 0}, {2.5, 0.2, 0.2, 1}).folds.count, 0u);
}

TEST_F(JudgeTest, TellsMissesHitsTooManyAndLeaks) {
  const Hit hit{2.5, 0, 0, 0};
  EXPECT_EQ(Judge(hit, Hit{}).missed_hits, (ErrorRate{1, 1}));
  EXPECT_EQ(Judge(hit, Hit{}).leaks, std::nullopt);
  EXPECT_EQ(Judge(hit, Hit{}, true).leaks, (ErrorRate{1, 1}));
  EXPECT_EQ(Judge(Hit{}, hit).extra_hits, (ErrorRate{1, 1}));
  EXPECT_EQ(Judge(Hit{}, Hit{}).missed_hits, (ErrorRate{0, 1}));
  EXPECT_EQ(Judge(Hit{}, Hit{}, true).leaks, (ErrorRate{1, 1}));
}

TEST(SpeedMeter, TracesTheRaysThatItTimes) {
  const Scene scene = MakeScene(test::IcoSphere({0, 0, 0}, 1, 3));
  const std::vector<Ray> rays = RandomRays(*scene.mesh, 20000, 3);
  SpeedMeter meter(scene, rays, Precision::kWatertight, 2);
  Arena(2).Run([&] {
    for (int run = 0; run < 3; ++run) {
      ASSERT_TRUE(meter.Run(std::chrono::milliseconds(20), {}).ok());
    }
  });
  std::vector<Hit> expected(rays.size());
  ASSERT_TRUE(TraceClosest(scene, std::span<const Ray>(rays), {}, expected).ok());
  ASSERT_GT(meter.hits().size(), 100u);
  expected.resize(meter.hits().size());
  EXPECT_THAT(meter.hits(), ElementsAreArray(expected));
  EXPECT_GT(meter.Sum().slowest, 1000);
}

}  // namespace
}  // namespace kdray::core
