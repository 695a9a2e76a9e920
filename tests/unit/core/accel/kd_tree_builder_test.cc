// SPDX-License-Identifier: Apache-2.0
#include "core/accel/kdtree/kd_tree_builder.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>
#include <string>
#include <vector>

#include "core/accel/kdtree/kd_build_task.h"
#include "core/accel/kdtree/kd_tree_stats.h"
#include "core/accel/kdtree/split.h"
#include "core/base/parallel.h"
#include "core/geometry/local_ray.h"
#include "tests/support/shapes.h"
#include "tests/unit/core/accel/tree_checks.h"

namespace kdray::test {
namespace {

using core::Bounds3f;
using core::BuildKdTree;
using core::KdBuildLimits;
using core::KdNode;
using core::KdSplitRule;
using core::KdTree;
using core::MeshData;
using core::PrimitiveId;
using core::SahCost;
using core::SplitPlane;
using core::TreeStats;
using core::TriangleMesh;
using core::WeightBudget;

constexpr KdSplitRule kAllRules[] = {KdSplitRule::kSah, KdSplitRule::kBinned, KdSplitRule::kCyclic,
                                     KdSplitRule::kMedian};

TriangleMesh Mesh(const MeshData& data) { return TriangleMesh::Create(data).value(); }

KdTree Build(const TriangleMesh& mesh, KdSplitRule rule, const SahCost& cost = {}) {
  return BuildKdTree(mesh, rule, cost, {}).value();
}

// f(node, cell, depth) for every node, depth first.
template <class F>
void Walk(const KdTree& tree, std::uint32_t index, const Bounds3f& cell, int depth, const F& f) {
  const KdNode& node = tree.nodes[index];
  f(node, cell, depth);
  if (node.IsLeaf()) return;
  const SplitPlane plane{node.axis(), node.split()};
  Walk(tree, index + 1, plane.BelowCell(cell), depth + 1, f);
  Walk(tree, node.above_child(), plane.AboveCell(cell), depth + 1, f);
}

std::vector<std::pair<std::string, MeshData>> Meshes() {
  return {{"sphere", UvSphere({5, 0, 0}, 1, 40, 60)},
          {"grids", Join(Grid(20, 1, 0.25), Grid(20, 2, 0.75))},
          {"large triangles", Soup(1500, 0.6, 1)},
          {"scattered", Soup(20'000, 0.02, 2)},
          {"straddling", Straddling(500, 3)},
          {"comb", Comb(400)},
          {"spiral", Spiral(3000, 30)},
          {"nest", Nest(99)}};
}

TEST(KdTreeBuilder, StaysWithinItsLimits) {
  for (const auto& [name, data] : Meshes()) {
    const TriangleMesh mesh = Mesh(data);
    const std::size_t triangles = mesh.triangle_count();
    for (const KdSplitRule rule : kAllRules) {
      SCOPED_TRACE(name + ", rule " + std::to_string(static_cast<int>(rule)));
      const KdTree tree = Build(mesh, rule);
      int depth_reached = 0;
      std::uint64_t weight = 0;
      Walk(tree, 0, tree.bounds, 0, [&](const KdNode& node, const Bounds3f& cell, int depth) {
        depth_reached = std::max(depth_reached, depth);
        if (!node.IsLeaf()) {
          ASSERT_TRUE((SplitPlane{node.axis(), node.split()}.IsInside(cell)));
          return;
        }
        weight += std::max<std::uint64_t>(KdBuildLimits::kLeafWeight, node.primitive_count());
        const auto leaf =
            std::span(tree.primitives).subspan(node.first_primitive(), node.primitive_count());
        const std::set<PrimitiveId> distinct(leaf.begin(), leaf.end());
        ASSERT_EQ(distinct.size(), leaf.size());
      });
      EXPECT_LE(depth_reached, KdBuildLimits::MaxDepth(triangles));
      EXPECT_LE(weight, KdBuildLimits::kWeightPerTriangle * triangles);
    }
  }
}

TEST(KdTreeBuilder, BoundsEveryNodeByWhatItsLeavesHold) {
  for (const auto& [name, data] : Meshes()) {
    const TriangleMesh mesh = Mesh(data);
    for (const KdSplitRule rule : kAllRules) {
      SCOPED_TRACE(name + ", rule " + std::to_string(static_cast<int>(rule)));
      const KdTree tree = Build(mesh, rule);
      ASSERT_EQ(tree.node_bounds.size(), tree.nodes.size());
      CheckReachability(tree, mesh);
      Walk(tree, 0, tree.bounds, 0, [&](const KdNode& node, const Bounds3f& cell, int) {
        const std::size_t i = static_cast<std::size_t>(&node - tree.nodes.data());
        const Bounds3f& bounds = tree.node_bounds[i];
        if (!node.IsLeaf()) {
          Bounds3f both = tree.node_bounds[i + 1];
          both.Extend(tree.node_bounds[node.above_child()]);
          ASSERT_EQ(bounds, both);
        } else if (node.primitive_count() == 0) {
          ASSERT_EQ(bounds, Bounds3f::Empty());
        } else {
          ASSERT_FALSE(bounds.IsEmpty());
          ASSERT_EQ(Intersection(bounds, cell), bounds);
        }
      });
    }
  }
}

TEST(KdTreeBuilder, NamesEveryTriangleButDegenerateOnes) {
  MeshData data = Soup(600, 0.2, 4);
  for (std::size_t i = 0; i < data.triangles.size(); i += 7) {
    data.triangles[i][2] = data.triangles[i][1];
  }
  const TriangleMesh mesh = Mesh(data);
  for (const KdSplitRule rule : kAllRules) {
    const KdTree tree = Build(mesh, rule);
    std::set<PrimitiveId> expected;
    for (PrimitiveId id = 0; id < mesh.triangle_count(); ++id) {
      if (!mesh.IsDegenerate(id)) expected.insert(id);
    }
    EXPECT_EQ(std::set<PrimitiveId>(tree.primitives.begin(), tree.primitives.end()), expected);
  }
}

TEST(KdTreeBuilder, MakesOneEmptyLeafOfAMeshOfDegenerateTriangles) {
  MeshData data;
  data.vertices = {{0, 0, 0}, {1, 1, 1}, {2, 2, 2}};
  data.triangles = {{0, 1, 2}, {0, 0, 1}};
  const TriangleMesh mesh = Mesh(data);
  for (const KdSplitRule rule : kAllRules) {
    const KdTree tree = Build(mesh, rule);
    ASSERT_EQ(tree.nodes.size(), 1u);
    EXPECT_EQ(tree.nodes[0].primitive_count(), 0u);
    EXPECT_TRUE(tree.bounds.IsEmpty());
    EXPECT_TRUE(tree.Cells(3, 10).value().empty());
  }
}

// Triangles apart along the diagonal: every median plane halves them, so the depth is that of a
// perfect binary tree with full leaves.
TEST(KdTreeBuilder, HalvesAStaircaseToTheDepthOfAPerfectTree) {
  for (int log = 0; log <= 12; ++log) {
    const TriangleMesh mesh = Mesh(Staircase(std::size_t{1} << log));
    const KdTree tree = Build(mesh, KdSplitRule::kMedian);
    const TreeStats stats = ComputeStats(tree, {});
    const int leaf_log = static_cast<int>(std::log2(KdBuildLimits::kMedianLeaf));
    const std::uint32_t depth = static_cast<std::uint32_t>(std::max(0, log - leaf_log));
    EXPECT_EQ(stats.max_depth, depth);
    EXPECT_EQ(stats.leaves, std::uint64_t{1} << depth);
    EXPECT_EQ(stats.references, mesh.triangle_count());
  }
}

TEST(KdTreeBuilder, KeepsCoincidentTrianglesInOneLeaf) {
  const TriangleMesh mesh = Mesh(Coincident(3000));
  for (const KdSplitRule rule : kAllRules) {
    const KdTree tree = Build(mesh, rule);
    ASSERT_EQ(tree.nodes.size(), 1u);
    EXPECT_EQ(tree.primitives.size(), 3000u);
  }
}

TEST(KdTreeBuilder, CutsOffTheEmptySpaceBetweenTwoClusters) {
  const TriangleMesh mesh =
      Mesh(RoundToFloat(Join(IcoSphere({-3, 0, 0}, 1, 2), IcoSphere({3, 0, 0}, 1, 2))));
  for (const KdSplitRule rule : {KdSplitRule::kSah, KdSplitRule::kBinned}) {
    const KdTree tree = Build(mesh, rule);
    // Local coordinates are an eighth of world ones: one cluster ends at -1/4, the other begins at
    // 1/4.
    bool ends = false, begins = false;
    Walk(tree, 0, tree.bounds, 0, [&](const KdNode& node, const Bounds3f& cell, int depth) {
      if (depth > 2 || node.IsLeaf() || node.axis() != 0) return;
      EXPECT_FALSE(cell.IsEmpty());
      ends |= std::fabs(node.split() + 0.25f) < 0.01f;
      begins |= std::fabs(node.split() - 0.25f) < 0.01f;
    });
    EXPECT_TRUE(ends && begins);
  }
}

TEST(KdTreeBuilder, PutsPlanarTrianglesIntoOneChildOnly) {
  const TriangleMesh mesh = Mesh(Join(Grid(8, 0, 0.5), Join(Grid(8, 0, 0), Grid(8, 0, 1))));
  const KdTree tree = Build(mesh, KdSplitRule::kSah);
  EXPECT_EQ(tree.primitives.size(), mesh.triangle_count());
}

TEST(KdTreeBuilder, ExactCandidatesCostLessThanBinnedOnes) {
  for (const auto& data :
       {UvSphere({0, 0, 0}, 1, 60, 80), BumpySphere({0, 0, 0}, 1, 50, 70, 0.3), Spiral(4000, 20)}) {
    const TriangleMesh mesh = Mesh(data);
    const SahCost cost;
    const double exact = ComputeStats(Build(mesh, KdSplitRule::kSah, cost), cost).sah_cost;
    const double binned = ComputeStats(Build(mesh, KdSplitRule::kBinned, cost), cost).sah_cost;
    const double cyclic = ComputeStats(Build(mesh, KdSplitRule::kCyclic, cost), cost).sah_cost;
    const double median = ComputeStats(Build(mesh, KdSplitRule::kMedian, cost), cost).sah_cost;
    EXPECT_LT(exact, binned);
    EXPECT_LT(exact, cyclic);
    EXPECT_LT(cyclic, median);
  }
}

TEST(KdTreeBuilder, FillsLeavesAsTheCostModelSays) {
  const TriangleMesh mesh = Mesh(UvSphere({0, 0, 0}, 1, 40, 60));
  const auto references = [&](double intersection) {
    return Build(mesh, KdSplitRule::kSah, SahCost{1, intersection, 0.8}).primitives.size();
  };
  EXPECT_LT(references(0.25), references(1));
  EXPECT_LT(references(1), references(4));
  // A triangle that costs next to nothing is not worth a step.
  EXPECT_EQ(Build(mesh, KdSplitRule::kSah, SahCost{1, 1e-6, 0.8}).nodes.size(), 1u);
}

TEST(KdBuildLimits, DepthGrowsWithTheLogarithmUpToTheTraversalsStack) {
  EXPECT_EQ(KdBuildLimits::MaxDepth(0), 8);
  EXPECT_EQ(KdBuildLimits::MaxDepth(1), 8);
  EXPECT_EQ(KdBuildLimits::MaxDepth(1024), 24);
  EXPECT_EQ(KdBuildLimits::MaxDepth(1 << 20), 40);
  EXPECT_EQ(KdBuildLimits::MaxDepth(std::size_t{1} << 40), KdTree::kMaxDepth);
}

TEST(WeightBudget, IsDividedInProportionAndWithoutLoss) {
  const WeightBudget budget(100);
  EXPECT_TRUE(budget.Allows(60, 40));
  EXPECT_FALSE(budget.Allows(60, 41));
  EXPECT_TRUE(budget.Allows(96, 0));
  EXPECT_FALSE(budget.Allows(97, 0));  // an empty leaf weighs something too
  EXPECT_TRUE(budget.AllowsAtTop(18, 18));
  EXPECT_FALSE(budget.AllowsAtTop(18, 19));

  const auto [below, above] = budget.Divide(30, 10);
  EXPECT_TRUE(below.Allows(71, 4));
  EXPECT_FALSE(below.Allows(72, 4));
  EXPECT_TRUE(above.Allows(21, 4));
  EXPECT_FALSE(above.Allows(22, 4));
}

// The deepest tree there may be: each plane has one more level below it.
KdTree Chain(int depth) {
  KdTree tree;
  tree.bounds = {{-1, -1, -1}, {1, 1, 1}};
  // Below children follow their parents; the leaves above come last, the deepest first.
  const std::uint32_t levels = static_cast<std::uint32_t>(depth);
  for (std::uint32_t i = 0; i < levels; ++i) {
    const float split = std::ldexp(1.0f, -static_cast<int>(i) - 1);
    tree.nodes.push_back(KdNode::Interior(0, split, 2 * levels - i));
  }
  for (std::uint32_t i = 0; i <= levels; ++i) {
    tree.nodes.push_back(KdNode::Leaf(i, 1));
    tree.primitives.push_back(i);
  }
  return tree;
}

TEST(KdTreeTraversal, HoldsTheDeepestTreeInBothDirections) {
  const KdTree tree = Chain(KdTree::kMaxDepth);
  CheckLayout(tree, KdTree::kMaxDepth + 1);
  for (const double direction : {1.0, -1.0}) {
    core::Ray ray;
    ray.origin = {-2 * direction, 0.1, 0.1};
    ray.direction = {direction, 0, 0};
    const auto local = core::MakeLocalRay(ray, core::MeshFrame{});
    ASSERT_TRUE(local);
    std::vector<PrimitiveId> visited;
    int nodes = 0;
    tree.Traverse(
        *local, 0,
        [&](std::span<const PrimitiveId> leaf) {
          visited.insert(visited.end(), leaf.begin(), leaf.end());
          return std::numeric_limits<double>::infinity();
        },
        [&] {
          ++nodes;
          return true;
        });
    std::vector<PrimitiveId> expected;
    for (PrimitiveId id = 0; id <= KdTree::kMaxDepth; ++id) expected.push_back(id);
    if (direction < 0) std::reverse(expected.begin(), expected.end());
    EXPECT_EQ(visited, expected);
    EXPECT_EQ(nodes, 2 * KdTree::kMaxDepth + 1);
  }
}

TEST(KdTreeCells, PartitionTheBoundsAtEveryDepth) {
  const TriangleMesh mesh = Mesh(BumpySphere({1, 2, 3}, 1, 20, 30, 0.2));
  const KdTree tree = Build(mesh, KdSplitRule::kSah);
  const auto volume = [](const core::Bounds3d& b) {
    const core::Vec3d e = b.Extent();
    return e.x * e.y * e.z;
  };
  const double whole = volume({core::Vec3d(tree.bounds.min), core::Vec3d(tree.bounds.max)});
  const TreeStats stats = ComputeStats(tree, {});
  for (std::uint32_t depth = 0; depth <= stats.max_depth + 1; ++depth) {
    const auto cells = tree.Cells(depth, 1'000'000).value();
    double sum = 0;
    std::uint64_t triangles = 0;
    for (const core::TreeCell& cell : cells) {
      EXPECT_LE(cell.depth, depth);
      EXPECT_TRUE(cell.leaf || cell.depth == depth);
      sum += volume(cell.bounds);
      triangles += cell.triangles;
    }
    EXPECT_NEAR(sum, whole, 1e-9 * whole);
    EXPECT_EQ(triangles, stats.references);
    if (depth == 0) {
      EXPECT_EQ(cells.size(), 1u);
    }
    if (depth >= stats.max_depth) {
      EXPECT_EQ(cells.size(), stats.leaves);
    }
    EXPECT_EQ(tree.Cells(depth, cells.size()).value().size(), cells.size());
    const auto refused = tree.Cells(depth, cells.size() - 1);
    ASSERT_FALSE(refused.ok());
    EXPECT_EQ(refused.error().code, core::ErrorCode::kInvalidArgument);
  }
}

}  // namespace
}  // namespace kdray::test
