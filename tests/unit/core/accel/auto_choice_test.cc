// SPDX-License-Identifier: Apache-2.0
// The numbers by which `auto` chooses a build, against closed forms and counted lines.
#include "core/accel/auto_choice.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>
#include <span>
#include <string>
#include <vector>

#include "core/accel/expected_cost.h"
#include "core/accel/tree.h"
#include "core/base/parallel.h"
#include "core/geometry/local_ray.h"
#include "core/geometry/ray.h"
#include "tests/support/seed.h"
#include "tests/support/shapes.h"

namespace kdray::test {
namespace {

using core::AutoChoice;
using core::BuildKind;
using core::MeshData;
using core::Tree;
using core::TriangleMesh;
using core::Vec3d;

TriangleMesh MeshOf(const MeshData& data) { return TriangleMesh::Create(data).value(); }
double OverlapOf(const MeshData& data) { return core::BoxOverlap(MeshOf(data)).value(); }

TEST(BoxOverlap, OfACubeIsFour) {
  // The box of each triangle is flat and as large as its face: 12 * 2 s^2 of 6 s^2.
  EXPECT_DOUBLE_EQ(OverlapOf(Cube({0, 0, 0}, 1)), 4);
}

TEST(BoxOverlap, OfAFlatGridIsTwo) {
  // Two triangles have the same box, and those of the quads fill the mesh's.
  for (int axis = 0; axis < 3; ++axis) EXPECT_NEAR(OverlapOf(Grid(8, axis, 0.25)), 2, 1e-12);
}

TEST(BoxOverlap, CountsCopiesOfATriangle) { EXPECT_NEAR(OverlapOf(Coincident(500)), 500, 1e-9); }

TEST(BoxOverlap, DoesNotChangeWithPositionAndSize) {
  const double overlap = OverlapOf(UvSphere({0, 0, 0}, 1, 20, 40));
  EXPECT_NEAR(OverlapOf(UvSphere({1000, -4096, 3}, 8, 20, 40)), overlap, 1e-9 * overlap);
}

TEST(BoxOverlap, LeavesDegenerateTrianglesOut) {
  MeshData data = Cube({0, 0, 0}, 1);
  data.vertices.push_back({50, 60, 70});
  data.triangles.push_back({0, 8, 8});
  EXPECT_DOUBLE_EQ(OverlapOf(data), 4);
  data.triangles = {{0, 8, 8}, {1, 1, 2}};
  EXPECT_EQ(OverlapOf(data), 0);
}

TEST(BoxOverlap, IsTheSameForEveryNumberOfThreads) {
  const TriangleMesh mesh = MeshOf(Soup(100'000, 0.1, 7));
  const double alone = core::BoxOverlap(mesh).value();
  for (const int threads : {1, 2, 5}) {
    double overlap = 0;
    core::Arena(threads).Run([&] { overlap = core::BoxOverlap(mesh).value(); });
    EXPECT_EQ(overlap, alone) << threads;
  }
}

TEST(BoxOverlap, EndsWhenItIsCancelled) {
  const auto cancel = core::CancelToken::Cancellable();
  cancel.Cancel();
  const auto overlap = core::BoxOverlap(MeshOf(Cube({0, 0, 0}, 1)), cancel);
  ASSERT_FALSE(overlap.ok());
  EXPECT_EQ(overlap.error().code, core::ErrorCode::kCancelled);
}

double CostOf(const MeshData& data, BuildKind build) {
  return core::ExpectedCost(core::BuildTree(MeshOf(data), build).value()).value();
}

TEST(ExpectedCost, OfOneBoxIsItsBlocks) {
  EXPECT_EQ(CostOf(Cube({0, 0, 0}, 1), BuildKind::kBox), 2);
  EXPECT_EQ(CostOf(Soup(80, 0.5, 1), BuildKind::kBox), 10);
  MeshData degenerate = Cube({0, 0, 0}, 1);
  degenerate.triangles = {{0, 0, 1}};
  EXPECT_EQ(CostOf(degenerate, BuildKind::kBvh), 0);
}

// A uniformly distributed line meets a box within another with the probability of the ratio of
// their areas (Cauchy), so the mean over many lines is the oracle.
TEST(ExpectedCost, IsTheMeanNumberOfNodesAndBlocksThatLinesMeet) {
  auto engine = RandomEngine(1990);
  std::normal_distribution<> normal;
  const auto direction = [&] {
    return core::Normalized(Vec3d{normal(engine), normal(engine), normal(engine)});
  };
  for (const BuildKind build : {BuildKind::kKdSah, BuildKind::kBvh}) {
    const TriangleMesh mesh = MeshOf(BumpySphere({1, 2, 3}, 1, 24, 48, 0.3));
    const Tree tree = core::BuildTree(mesh, build).value();
    const core::Bounds3d& bounds = mesh.bounds();
    const double radius = core::Length(bounds.Extent());
    std::size_t lines = 0, met = 0;
    while (lines < 20'000) {
      // Uniform lines through a ball: a direction, and a point of the disc across it.
      const Vec3d along = direction();
      const Vec3d across = core::Normalized(core::Cross(along, direction()));
      const double off = radius * std::sqrt(std::uniform_real_distribution<>(0, 1)(engine));
      core::Ray ray;
      ray.origin = bounds.Center() + across * off - along * (2 * radius);
      ray.direction = along;
      const auto local = core::MakeLocalRay(ray, mesh.frame());
      if (!local) continue;
      std::size_t visits = 0;
      tree.wide.Traverse(
          *local, 0,
          [](std::span<const core::PrimitiveId>) {
            return std::numeric_limits<double>::infinity();
          },
          [&] {
            ++visits;
            return true;
          });
      if (visits == 0) continue;  // misses the bounds
      ++lines;
      met += visits;
    }
    const double mean = static_cast<double>(met) / static_cast<double>(lines);
    EXPECT_NEAR(core::ExpectedCost(tree).value(), mean, 0.03 * mean) << core::Name(build);
  }
}

TEST(ExpectedCost, EndsWhenItIsCancelled) {
  const auto cancel = core::CancelToken::Cancellable();
  cancel.Cancel();
  const Tree tree = core::BuildTree(MeshOf(Soup(1000, 0.1, 2)), BuildKind::kBvh).value();
  const auto cost = core::ExpectedCost(tree, cancel);
  ASSERT_FALSE(cost.ok());
  EXPECT_EQ(cost.error().code, core::ErrorCode::kCancelled);
}

TEST(AutoChoice, IsKdSahIfItsCostIsLessThanThreeQuarters) {
  AutoChoice choice;
  EXPECT_EQ(choice.build(), BuildKind::kBvh) << "nothing to compare";
  choice.costs = {10, 7.4};
  EXPECT_EQ(choice.build(), BuildKind::kKdSah);
  choice.costs = {10, 7.6};
  EXPECT_EQ(choice.build(), BuildKind::kBvh);
  choice.costs = {9, 10};
  EXPECT_EQ(choice.build(), BuildKind::kBvh);
}

TEST(AutoChoice, ComparesWhereBoxesOverlap) {
  AutoChoice choice;
  choice.overlap = AutoChoice::kLittleOverlap;
  EXPECT_TRUE(choice.OverlapsLittle());
  choice.overlap = std::nextafter(AutoChoice::kLittleOverlap, 1e9);
  EXPECT_FALSE(choice.OverlapsLittle());
}

}  // namespace
}  // namespace kdray::test
