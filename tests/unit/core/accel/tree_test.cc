// SPDX-License-Identifier: Apache-2.0
// Every build on every kind of mesh: the structure holds what its traversal relies on.
#include "core/accel/tree.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <memory>
#include <string>
#include <thread>
#include <variant>
#include <vector>

#include "core/base/parallel.h"
#include "core/scene/scene.h"
#include "tests/support/shapes.h"
#include "tests/unit/core/accel/tree_checks.h"

namespace kdray::test {
namespace {

using core::BuildKind;
using core::MeshData;
using core::Tree;
using core::TriangleMesh;

struct NamedMesh {
  const char* name;
  MeshData data;
};

// Each kind of trouble once, small enough for a check that is quadratic in places.
std::vector<NamedMesh> Zoo() {
  std::vector<NamedMesh> zoo;
  zoo.push_back({"sphere", UvSphere({3, 2, 1}, 2, 24, 48)});
  zoo.push_back({"float sphere", RoundToFloat(IcoSphere({0.1, 0.2, 0.3}, 1, 3))});
  zoo.push_back({"bumpy sphere", BumpySphere({0, 0, 0}, 1, 30, 40, 0.3)});
  zoo.push_back({"cube", Cube({0, 0, 0}, 1)});
  for (int axis = 0; axis < 3; ++axis) zoo.push_back({"grid", Grid(16, axis, 0.3)});
  zoo.push_back({"two grids", Join(Grid(9, 0, 0.5), Grid(9, 2, 0.5))});
  zoo.push_back({"fine soup", Soup(3000, 0.02, 1)});
  zoo.push_back({"coarse soup", Soup(300, 0.7, 2)});
  zoo.push_back({"coincident", Coincident(500)});
  zoo.push_back({"straddling", Straddling(400, 3)});
  zoo.push_back({"comb", Comb(300)});
  zoo.push_back({"spiral", Spiral(2000, 20)});
  zoo.push_back({"staircase", Staircase(256)});
  zoo.push_back({"nest", Nest(99)});
  zoo.push_back({"large", Soup(20'000, 0.01, 4)});
  MeshData degenerate = Soup(100, 0.3, 5);
  for (std::size_t i = 0; i < 100; i += 3) degenerate.triangles[i][2] = degenerate.triangles[i][0];
  zoo.push_back({"partly degenerate", degenerate});
  MeshData single;
  single.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  single.triangles = {{0, 1, 2}};
  zoo.push_back({"one triangle", single});
  single.triangles = {{0, 1, 1}};
  zoo.push_back({"nothing but degenerate", single});
  return zoo;
}

TEST(BuildTree, HoldsWhatTraversalReliesOnForEveryBuildAndMesh) {
  for (const NamedMesh& item : Zoo()) {
    const TriangleMesh mesh = TriangleMesh::Create(item.data).value();
    for (const BuildKind kind : core::kAllBuildKinds) {
      SCOPED_TRACE(std::string(item.name) + ", " + std::string(Name(kind)));
      const auto tree = core::BuildTree(mesh, kind);
      ASSERT_TRUE(tree.ok());
      EXPECT_EQ(tree->build, kind);
      EXPECT_TRUE(tree->wide.Validate(mesh.triangle_count()).ok());
      std::visit(
          [&](const auto& structure) {
            CheckLayout(structure, mesh.triangle_count());
            CheckReachability(structure, mesh);
          },
          *tree->Binary(mesh).value());
    }
  }
}

template <class T>
requires requires(const T& v) { v.data(); }
bool SameBytes(const T& a, const T& b) {
  // memcmp takes no null pointers, not even for no bytes.
  return a.size() == b.size() &&
         (a.size() == 0 || std::memcmp(a.data(), b.data(), a.size() * sizeof(a[0])) == 0);
}
bool SameBytes(const core::KdTree& a, const core::KdTree& b) {
  return a.bounds == b.bounds && SameBytes(a.nodes, b.nodes) &&
         SameBytes(a.primitives, b.primitives);
}
bool SameBytes(const core::Bvh& a, const core::Bvh& b) {
  return SameBytes(a.nodes, b.nodes) && SameBytes(a.primitives, b.primitives);
}
bool SameBytes(const core::BoxList& a, const core::BoxList& b) {
  return a.bounds == b.bounds && a.primitives == b.primitives;
}

// Large enough for nodes that are split and counted in parallel.
TEST(BuildTree, GivesTheSameBytesForEveryNumberOfThreads) {
  const TriangleMesh mesh =
      TriangleMesh::Create(Join(BumpySphere({0.5, 0.5, 0.5}, 0.5, 90, 130, 0.3),
                                Join(Soup(12'000, 0.02, 6), Straddling(500, 7))))
          .value();
  for (const BuildKind kind : core::kAllBuildKinds) {
    SCOPED_TRACE(std::string(Name(kind)));
    const Tree alone = core::BuildTree(mesh, kind).value();
    for (const int threads : {1, 2, 4}) {
      core::Arena arena(threads);
      arena.Run([&] {
        const Tree tree = core::BuildTree(mesh, kind).value();
        EXPECT_EQ(tree.stats, alone.stats);
        EXPECT_TRUE(SameBytes(tree.wide.nodes, alone.wide.nodes));
        EXPECT_TRUE(SameBytes(tree.wide.blocks, alone.wide.blocks));
        std::visit(
            [&](const auto& a) {
              using Structure = std::decay_t<decltype(a)>;
              EXPECT_TRUE(SameBytes(a, std::get<Structure>(*alone.Binary(mesh).value())));
            },
            *tree.Binary(mesh).value());
      });
    }
  }
}

// Once more by the cells, which are found another way than the statistics.
TEST(BuildTree, CountsWhatIsThere) {
  const TriangleMesh mesh = TriangleMesh::Create(UvSphere({0, 0, 0}, 1, 30, 40)).value();
  for (const BuildKind kind : core::kAllBuildKinds) {
    SCOPED_TRACE(std::string(Name(kind)));
    const Tree tree = core::BuildTree(mesh, kind).value();
    const core::TreeStats& stats = tree.stats;
    std::visit(
        [&](const auto& structure) {
          const auto leaves = structure.Cells(1000, 1'000'000).value();
          const auto root = structure.Cells(0, 1).value().front();
          core::TreeStats recount;
          double cost = 0;
          for (const core::TreeCell& leaf : leaves) {
            core::CountLeaf(leaf.triangles, leaf.depth, &recount);
            const double blocks = std::ceil(static_cast<double>(leaf.triangles) / 8);
            cost += leaf.bounds.SurfaceArea() * stats.intersection_cost * blocks;
          }
          // Every interior node once: cells that are no leaf, depth by depth.
          std::uint64_t interior = 0;
          for (std::uint32_t depth = 0; depth < stats.max_depth; ++depth) {
            const auto cells = structure.Cells(depth, 1'000'000).value();
            for (const core::TreeCell& cell : cells) {
              if (cell.leaf) continue;
              ++interior;
              cost += cell.bounds.SurfaceArea() * stats.traversal_cost;
            }
          }
          EXPECT_EQ(stats.leaves, recount.leaves);
          EXPECT_EQ(stats.empty_leaves, recount.empty_leaves);
          EXPECT_EQ(stats.references, recount.references);
          EXPECT_EQ(stats.max_depth, recount.max_depth);
          EXPECT_EQ(stats.leaf_histogram, recount.leaf_histogram);
          const auto largest = std::max_element(
              leaves.begin(), leaves.end(),
              [](const auto& a, const auto& b) { return a.triangles < b.triangles; });
          EXPECT_EQ(stats.max_leaf, largest->triangles);
          EXPECT_EQ(stats.nodes, interior + recount.leaves);
          EXPECT_NEAR(stats.sah_cost, cost / root.bounds.SurfaceArea(), 1e-9 * stats.sah_cost);
        },
        *tree.Binary(mesh).value());
    EXPECT_EQ(stats.bytes, tree.bytes());
    EXPECT_GT(stats.intersection_cost, 0);
    EXPECT_GT(stats.traversal_cost, 0);
  }
}

TEST(TreeStats, CountLargeLeavesTogether) {
  core::TreeStats stats;
  for (const std::size_t triangles : {0u, 3u, 3u, 64u, 65u, 1'000'000'000u, 70u}) {
    core::CountLeaf(triangles, 0, &stats);
  }
  ASSERT_EQ(stats.leaf_histogram.size(), 66u);
  EXPECT_EQ(stats.leaf_histogram[0], 1u);
  EXPECT_EQ(stats.leaf_histogram[3], 2u);
  EXPECT_EQ(stats.leaf_histogram[64], 1u);
  EXPECT_EQ(stats.leaf_histogram[65], 3u);
  EXPECT_EQ(stats.max_leaf, 1'000'000'000u);
}

TEST(BuildTree, StopsWhenItIsCancelledOrLate) {
  const TriangleMesh mesh = TriangleMesh::Create(Soup(5000, 0.1, 8)).value();
  for (const BuildKind kind : core::kAllBuildKinds) {
    core::BuildOptions options;
    options.cancel = core::CancelToken::Cancellable();
    EXPECT_TRUE(core::BuildTree(mesh, kind, options).ok());
    options.cancel.Cancel();
    const auto cancelled = core::BuildTree(mesh, kind, options);
    ASSERT_FALSE(cancelled.ok());
    EXPECT_EQ(cancelled.error().code, core::ErrorCode::kCancelled);

    options.cancel = core::CancelToken::WithDeadline(core::CancelToken::Clock::now());
    const auto late = core::BuildTree(mesh, kind, options);
    ASSERT_FALSE(late.ok());
    EXPECT_EQ(late.error().code, core::ErrorCode::kDeadlineExceeded);
  }
}

TEST(BuildTree, StopsInTheMiddleOfItsWork) {
  const TriangleMesh mesh = TriangleMesh::Create(Soup(200'000, 0.01, 9)).value();
  for (const BuildKind kind : {BuildKind::kKdSah, BuildKind::kBvh}) {
    core::Progress progress;
    core::BuildOptions options;
    options.cancel = core::CancelToken::Cancellable();
    options.progress = &progress;
    std::jthread watcher([&](const std::stop_token& done) {
      while (progress.fraction() == 0 && !done.stop_requested()) std::this_thread::yield();
      options.cancel.Cancel();
    });
    const auto tree = core::BuildTree(mesh, kind, options);
    watcher.request_stop();
    ASSERT_FALSE(tree.ok()) << Name(kind);
    EXPECT_EQ(tree.error().code, core::ErrorCode::kCancelled);
  }
}

TEST(BuildTree, ReportsProgressThatEndsAtOne) {
  const TriangleMesh mesh = TriangleMesh::Create(Soup(20'000, 0.02, 10)).value();
  for (const BuildKind kind : core::kAllBuildKinds) {
    core::Progress progress;
    core::BuildOptions options;
    options.progress = &progress;
    ASSERT_TRUE(core::BuildTree(mesh, kind, options).ok());
    EXPECT_EQ(progress.fraction(), 1.0);
  }
}

TEST(EstimateBuildBytes, GrowsWithTheMeshAndHoldsAtLeastTheTree) {
  const TriangleMesh mesh = TriangleMesh::Create(Soup(3000, 0.02, 11)).value();
  for (const BuildKind kind : core::kAllBuildKinds) {
    EXPECT_GE(core::EstimateBuildBytes(3000, kind), core::BuildTree(mesh, kind)->bytes());
    EXPECT_LT(core::EstimateBuildBytes(1000, kind), core::EstimateBuildBytes(1'000'000, kind));
  }
}

TEST(SceneCells, AreInWorldUnits) {
  const core::Vec3d center{1000, -2000, 3000};
  const auto mesh =
      std::make_shared<const TriangleMesh>(TriangleMesh::Create(Cube(center, 0.5)).value());
  for (const BuildKind kind : core::kAllBuildKinds) {
    const core::Scene scene{mesh,
                            std::make_shared<const Tree>(core::BuildTree(*mesh, kind).value())};
    const auto cells = scene.Cells(0, 10).value();
    ASSERT_EQ(cells.size(), 1u);
    EXPECT_EQ(cells[0].bounds, (core::Bounds3d{center - core::Vec3d{0.5, 0.5, 0.5},
                                               center + core::Vec3d{0.5, 0.5, 0.5}}));
    EXPECT_FALSE(scene.Cells(0, 0).ok());
  }
}

}  // namespace
}  // namespace kdray::test
