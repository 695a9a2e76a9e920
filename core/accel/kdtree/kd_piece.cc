// SPDX-License-Identifier: Apache-2.0
#include "core/accel/kdtree/kd_piece.h"

#include <algorithm>

#include "core/base/parallel.h"

namespace kdray::core {

namespace {

// The numbers of a subtree's nodes and primitives, or their first positions.
struct Size {
  std::size_t nodes = 0;
  std::size_t primitives = 0;
};

Size operator+(const Size& a, const Size& b) {
  return {a.nodes + b.nodes, a.primitives + b.primitives};
}

Size Measure(const KdUpperNode& node) {
  if (!node.below) return {node.piece.nodes.size(), node.piece.primitives.size()};
  return Size{1, 0} + Measure(*node.below) + Measure(*node.above);
}

void Put(KdPiece piece, const Size& place, KdTree* tree) {
  const std::uint32_t first_node = static_cast<std::uint32_t>(place.nodes);
  const std::uint32_t first_primitive = static_cast<std::uint32_t>(place.primitives);
  const auto moved = [&](const KdNode& node) {
    return node.IsLeaf()
               ? KdNode::Leaf(first_primitive + node.first_primitive(), node.primitive_count())
               : KdNode::Interior(node.axis(), node.split(), first_node + node.above_child());
  };
  std::transform(piece.nodes.begin(), piece.nodes.end(), &tree->nodes[place.nodes], moved);
  std::copy(piece.node_bounds.begin(), piece.node_bounds.end(), &tree->node_bounds[place.nodes]);
  std::copy(piece.primitives.begin(), piece.primitives.end(),
            tree->primitives.data() + place.primitives);
}

void Put(KdUpperNode* node, const Size& place, BuildMonitor* monitor, KdTree* tree) {
  if (!node->below) {
    if (monitor->ShouldStop()) return;
    Put(std::move(node->piece), place, tree);
    return;
  }
  const Size below = place + Size{1, 0};
  const Size above = below + Measure(*node->below);
  ParallelInvoke([&] { Put(node->below.get(), below, monitor, tree); },
                 [&] { Put(node->above.get(), above, monitor, tree); });
  tree->nodes[place.nodes] = KdNode::Interior(node->plane.axis, node->plane.position,
                                              static_cast<std::uint32_t>(above.nodes));
  Bounds3f bounds = tree->node_bounds[below.nodes];
  bounds.Extend(tree->node_bounds[above.nodes]);
  tree->node_bounds[place.nodes] = bounds;
}

}  // namespace

void Assemble(KdUpperNode* root, BuildMonitor* monitor, KdTree* tree) {
  const Size size = Measure(*root);
  tree->nodes.resize(size.nodes);
  tree->node_bounds.resize(size.nodes);
  tree->primitives.resize(size.primitives);
  Put(root, {}, monitor, tree);
}

}  // namespace kdray::core
