// SPDX-License-Identifier: Apache-2.0
#include "core/accel/bvh/bvh_builder.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "tests/support/shapes.h"
#include "tests/unit/core/accel/tree_checks.h"

namespace kdray::test {
namespace {

using core::Bounds3f;
using core::Bvh;
using core::BvhNode;
using core::MeshData;
using core::PrimitiveId;
using core::TriangleMesh;

TriangleMesh Mesh(const MeshData& data) { return TriangleMesh::Create(data).value(); }

Bvh Build(const TriangleMesh& mesh) { return core::BuildBvh(mesh, {}, {}).value(); }

bool Inside(const Bounds3f& inner, const Bounds3f& outer) {
  return outer.Contains(inner.min) && outer.Contains(inner.max);
}

TEST(BvhBuilder, HoldsEveryTriangleOnceInBoxesThatNest) {
  for (const auto& data : {UvSphere({0, 0, 0}, 1, 40, 60), Soup(2000, 0.3, 1), Nest(99),
                           Coincident(100), Soup(20'000, 0.01, 2)}) {
    const TriangleMesh mesh = Mesh(data);
    const Bvh bvh = Build(mesh);
    std::vector<PrimitiveId> ids = bvh.primitives;
    std::sort(ids.begin(), ids.end());
    ASSERT_EQ(ids.size(), mesh.triangle_count());
    for (PrimitiveId id = 0; id < ids.size(); ++id) ASSERT_EQ(ids[id], id);

    std::size_t in_leaves = 0;
    for (std::size_t i = 0; i < bvh.nodes.size(); ++i) {
      const BvhNode& node = bvh.nodes[i];
      if (!node.IsLeaf()) {
        ASSERT_TRUE(Inside(bvh.nodes[i + 1].bounds, node.bounds));
        ASSERT_TRUE(Inside(bvh.nodes[node.offset].bounds, node.bounds));
        continue;
      }
      in_leaves += node.primitive_count;
      for (std::uint32_t k = 0; k < node.primitive_count; ++k) {
        for (int corner = 0; corner < 3; ++corner) {
          const core::Vec3d p = mesh.LocalCorner(bvh.primitives[node.offset + k], corner);
          ASSERT_TRUE((core::Bounds3d{core::Vec3d(node.bounds.min), core::Vec3d(node.bounds.max)})
                          .Contains(p));
        }
      }
    }
    EXPECT_EQ(in_leaves, mesh.triangle_count());
  }
}

TEST(BvhBuilder, MakesNoNodesOfAMeshOfDegenerateTriangles) {
  MeshData data;
  data.vertices = {{0, 0, 0}, {1, 1, 1}};
  data.triangles = {{0, 1, 1}};
  const Bvh bvh = Build(Mesh(data));
  EXPECT_TRUE(bvh.nodes.empty());
  EXPECT_TRUE(bvh.Cells(2, 10).value().empty());
}

// Sizes that double from one triangle to the next: bins of equal width part only the largest few
// from the rest, again and again.
TEST(BvhBuilder, StaysWithinTheTraversalsStackOverAHugeRangeOfSizes) {
  MeshData data;
  for (int e = 0; e > -120; --e) {
    for (int copy = 0; copy < 300; ++copy) {
      const double s = std::ldexp(1.0 + copy * 0x1p-12, e);
      const std::uint32_t first = static_cast<std::uint32_t>(data.vertices.size());
      data.vertices.insert(data.vertices.end(), {{s, 0, 0}, {s, s * 0.001, 0}, {s, 0, s * 0.001}});
      data.triangles.push_back({first, first + 1, first + 2});
    }
  }
  const TriangleMesh mesh = Mesh(data);
  const Bvh bvh = Build(mesh);
  CheckLayout(bvh, mesh.triangle_count());
  const core::TreeStats stats = ComputeStats(bvh, {});
  EXPECT_GT(stats.max_depth, 32u);  // where halving by number begins
  EXPECT_LE(stats.max_depth, static_cast<std::uint32_t>(Bvh::kMaxDepth));
  EXPECT_LT(stats.max_leaf, 32u);
}

TEST(BvhCells, AreTheNodesAtADepthAndTheLeavesAbove) {
  const TriangleMesh mesh = Mesh(BumpySphere({1, 2, 3}, 1, 20, 30, 0.2));
  const Bvh bvh = Build(mesh);
  const core::TreeStats stats = ComputeStats(bvh, {});
  for (std::uint32_t depth = 0; depth <= stats.max_depth + 1; ++depth) {
    const auto cells = bvh.Cells(depth, 1'000'000).value();
    std::uint64_t triangles = 0;
    for (const core::TreeCell& cell : cells) {
      EXPECT_TRUE(cell.leaf ? cell.depth <= depth : cell.depth == depth);
      triangles += cell.triangles;
    }
    EXPECT_EQ(triangles, mesh.triangle_count());
    EXPECT_EQ(bvh.Cells(depth, cells.size()).value().size(), cells.size());
    EXPECT_FALSE(bvh.Cells(depth, cells.size() - 1).ok());
  }
}

}  // namespace
}  // namespace kdray::test
