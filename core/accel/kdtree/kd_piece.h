// SPDX-License-Identifier: Apache-2.0
// The parts of an unfinished kd-tree: subtrees that are built separately, then assembled.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "core/accel/build_monitor.h"
#include "core/accel/kdtree/kd_node.h"
#include "core/accel/kdtree/kd_tree.h"
#include "core/accel/kdtree/split.h"
#include "core/geometry/bounds3.h"
#include "core/geometry/hit.h"

namespace kdray::core {

/// A subtree in the layout of KdTree, with positions relative to its beginning.
struct KdPiece {
  std::vector<KdNode> nodes;
  std::vector<Bounds3f> node_bounds;
  std::vector<PrimitiveId> primitives;

  void Clear() {
    nodes.clear();
    node_bounds.clear();
    primitives.clear();
  }
  /// Interior nodes are written before their children, so the rest is filled in later.
  std::size_t BeginInterior() {
    nodes.emplace_back();
    node_bounds.emplace_back();
    return nodes.size() - 1;
  }
  /// Call between the children: the next node is the above child.
  void EndBelow(std::size_t interior, const SplitPlane& plane) {
    nodes[interior] =
        KdNode::Interior(plane.axis, plane.position, static_cast<std::uint32_t>(nodes.size()));
  }
  /// Call when both children are complete.
  void EndInterior(std::size_t interior) {
    Bounds3f bounds = node_bounds[interior + 1];
    bounds.Extend(node_bounds[nodes[interior].above_child()]);
    node_bounds[interior] = bounds;
  }
  /// Makes a leaf of the last `count` primitives that were pushed.
  void EndLeaf(std::size_t count, const Bounds3f& bounds) {
    nodes.push_back(KdNode::Leaf(static_cast<std::uint32_t>(primitives.size() - count),
                                 static_cast<std::uint32_t>(count)));
    node_bounds.push_back(bounds);
  }
};

/// The upper part of a tree, whose nodes are built in parallel: a split with two halves, or a
/// piece.
struct KdUpperNode {
  SplitPlane plane;
  std::unique_ptr<KdUpperNode> below, above;  ///< both or none
  KdPiece piece;                              ///< if there are no children
};

/// Assembles the pieces, depth first, into *tree, and frees them. In parallel. *tree is unspecified
/// if the monitor stops.
void Assemble(KdUpperNode* root, BuildMonitor* monitor, KdTree* tree);

}  // namespace kdray::core
