// SPDX-License-Identifier: Apache-2.0
#include "tests/unit/core/accel/tree_checks.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>
#include <span>
#include <vector>

#include "tests/support/seed.h"

namespace kdray::test {

using core::Bounds3d;
using core::Bounds3f;
using core::BvhNode;
using core::KdNode;
using core::PrimitiveId;
using core::TriangleMesh;
using core::Vec3d;

namespace {

struct Sample {
  Vec3d point;
  // How far rounding may have moved the point off the triangle.
  double slack;
};

std::vector<Sample> SamplesOf(const TriangleMesh& mesh, PrimitiveId id, std::mt19937_64& engine) {
  const Vec3d a = mesh.LocalCorner(id, 0);
  const Vec3d b = mesh.LocalCorner(id, 1);
  const Vec3d c = mesh.LocalCorner(id, 2);
  const double size = std::max({MaxAbs(a), MaxAbs(b), MaxAbs(c)});
  const double slack = 0x1p-50 * size;
  std::vector<Sample> samples = {{a, 0},
                                 {b, 0},
                                 {c, 0},
                                 {a * 0.5 + b * 0.5, slack},
                                 {b * 0.5 + c * 0.5, slack},
                                 {c * 0.5 + a * 0.5, slack}};
  for (int i = 0; i < 6; ++i) {
    double u = std::ldexp(static_cast<double>(engine() >> 11), -53);
    double v = std::ldexp(static_cast<double>(engine() >> 11), -53);
    if (u + v > 1) {
      u = 1 - u;
      v = 1 - v;
    }
    samples.push_back({a * (1 - u - v) + b * u + c * v, slack});
  }
  return samples;
}

bool Contains(const Bounds3f& box, const Sample& sample) {
  for (int axis = 0; axis < 3; ++axis) {
    if (sample.point[axis] < static_cast<double>(box.min[axis]) - sample.slack) return false;
    if (sample.point[axis] > static_cast<double>(box.max[axis]) + sample.slack) return false;
  }
  return true;
}

bool Holds(std::span<const PrimitiveId> leaf, PrimitiveId id) {
  return std::find(leaf.begin(), leaf.end(), id) != leaf.end();
}

bool Reaches(const core::KdTree& tree, std::uint32_t index, const Sample& sample, PrimitiveId id) {
  const KdNode& node = tree.nodes[index];
  if (!tree.node_bounds.empty() && !Contains(tree.node_bounds[index], sample)) return false;
  if (node.IsLeaf()) {
    return Holds(std::span(tree.primitives).subspan(node.first_primitive(), node.primitive_count()),
                 id);
  }
  const double to_plane = static_cast<double>(node.split()) - sample.point[node.axis()];
  return (to_plane >= -sample.slack && Reaches(tree, index + 1, sample, id)) ||
         (to_plane <= sample.slack && Reaches(tree, node.above_child(), sample, id));
}

bool Reaches(const core::Bvh& tree, std::uint32_t index, const Sample& sample, PrimitiveId id) {
  const BvhNode& node = tree.nodes[index];
  if (!Contains(node.bounds, sample)) return false;
  if (node.IsLeaf()) {
    return Holds(std::span(tree.primitives).subspan(node.offset, node.primitive_count), id);
  }
  return Reaches(tree, index + 1, sample, id) || Reaches(tree, node.offset, sample, id);
}

template <class Reached>
void CheckAll(const TriangleMesh& mesh, const Reached& reached) {
  std::mt19937_64 engine = RandomEngine(17);
  for (std::size_t i = 0; i < mesh.triangle_count(); ++i) {
    const PrimitiveId id = static_cast<PrimitiveId>(i);
    if (mesh.IsDegenerate(id)) continue;
    for (const Sample& sample : SamplesOf(mesh, id, engine)) {
      ASSERT_TRUE(reached(sample, id)) << "triangle " << id << " at " << sample.point.x << " "
                                       << sample.point.y << " " << sample.point.z;
    }
  }
}

void CheckPrimitives(std::span<const PrimitiveId> primitives, std::size_t triangle_count) {
  for (const PrimitiveId id : primitives) ASSERT_LT(id, triangle_count);
}

void CheckBox(const Bounds3f& box) {
  ASSERT_FALSE(box.IsEmpty());
  ASSERT_TRUE(IsFinite(box.Extent()));
}

// A node's first child comes next, its second after the whole subtree of the first.
// second_child(node) of an interior node; end(node) of a leaf is where its primitives end.
template <class Node, class SecondChild, class End>
void CheckDepthFirst(std::span<const Node> nodes, int max_depth, std::size_t primitives,
                     const SecondChild& second_child, const End& end) {
  struct PendingSecond {
    std::uint32_t node;
    int depth;
  };
  std::vector<PendingSecond> pending;
  int depth = 0;
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    if (!nodes[i].IsLeaf()) {
      ASSERT_LE(++depth, max_depth) << "node " << i;
      pending.push_back({second_child(nodes[i]), depth});
      continue;
    }
    ASSERT_LE(end(nodes[i]), primitives) << "leaf " << i;
    if (pending.empty()) {
      ASSERT_EQ(i + 1, nodes.size()) << "nodes without a parent";
      return;
    }
    ASSERT_EQ(pending.back().node, i + 1) << "the second child of its parent";
    depth = pending.back().depth;
    pending.pop_back();
  }
  FAIL() << "the tree ends within a node's children";
}

}  // namespace

void CheckReachability(const core::KdTree& tree, const TriangleMesh& mesh) {
  CheckAll(mesh, [&](const Sample& sample, PrimitiveId id) {
    return Contains(tree.bounds, sample) && Reaches(tree, 0, sample, id);
  });
}

void CheckReachability(const core::Bvh& tree, const TriangleMesh& mesh) {
  CheckAll(mesh, [&](const Sample& sample, PrimitiveId id) {
    return !tree.nodes.empty() && Reaches(tree, 0, sample, id);
  });
}

void CheckReachability(const core::BoxList& tree, const TriangleMesh& mesh) {
  CheckAll(mesh, [&](const Sample& sample, PrimitiveId id) {
    return Contains(tree.bounds, sample) && std::ranges::binary_search(tree.primitives, id);
  });
}

void CheckLayout(const core::KdTree& tree, std::size_t triangle_count) {
  if (tree.bounds != Bounds3f::Empty()) CheckBox(tree.bounds);
  CheckPrimitives(tree.primitives, triangle_count);
  for (const KdNode& node : tree.nodes) ASSERT_TRUE(node.IsLeaf() || std::isfinite(node.split()));
  CheckDepthFirst(
      std::span<const KdNode>(tree.nodes), core::KdTree::kMaxDepth, tree.primitives.size(),
      [](const KdNode& node) { return node.above_child(); },
      [](const KdNode& node) {
        return std::uint64_t{node.first_primitive()} + node.primitive_count();
      });
}

void CheckLayout(const core::Bvh& tree, std::size_t triangle_count) {
  CheckPrimitives(tree.primitives, triangle_count);
  if (tree.nodes.empty()) return;
  for (const BvhNode& node : tree.nodes) CheckBox(node.bounds);
  CheckDepthFirst(
      std::span<const BvhNode>(tree.nodes), core::Bvh::kMaxDepth, tree.primitives.size(),
      [](const BvhNode& node) { return node.offset; },
      [](const BvhNode& node) { return std::uint64_t{node.offset} + node.primitive_count; });
}

void CheckLayout(const core::BoxList& tree, std::size_t triangle_count) {
  if (tree.bounds != Bounds3f::Empty()) CheckBox(tree.bounds);
  CheckPrimitives(tree.primitives, triangle_count);
}

}  // namespace kdray::test
