// SPDX-License-Identifier: Apache-2.0
#include "core/accel/kdtree/kd_tree_stats.h"

#include <vector>

#include "core/accel/kdtree/split.h"
#include "core/base/cancel_poll.h"

namespace kdray::core {

TreeStats ComputeStats(const KdTree& tree, const SahCost& cost, const CancelToken& cancel) {
  TreeStats stats;
  stats.nodes = tree.nodes.size();
  stats.bytes = tree.bytes();
  stats.traversal_cost = cost.traversal;
  stats.intersection_cost = cost.intersection;

  struct Entry {
    std::uint32_t node;
    std::uint32_t depth;
    Bounds3f cell;
  };
  const auto area = [](const Bounds3f& cell) {
    return Bounds3d{Vec3d(cell.min), Vec3d(cell.max)}.SurfaceArea();
  };
  const double whole = area(tree.bounds);
  double weighed_cost = 0;
  std::vector<Entry> pending = {{0, 0, tree.bounds}};
  CancelPoll poll(cancel);
  while (!pending.empty() && !poll.Spend(16)) {
    const Entry entry = pending.back();
    pending.pop_back();
    const KdNode& node = tree.nodes[entry.node];
    if (node.IsLeaf()) {
      CountLeaf(node.primitive_count(), entry.depth, &stats);
      weighed_cost += area(entry.cell) * cost.Leaf(node.primitive_count());
      continue;
    }
    weighed_cost += area(entry.cell) * cost.traversal;
    const SplitPlane plane{node.axis(), node.split()};
    pending.push_back({node.above_child(), entry.depth + 1, plane.AboveCell(entry.cell)});
    pending.push_back({entry.node + 1, entry.depth + 1, plane.BelowCell(entry.cell)});
  }
  if (whole > 0) stats.sah_cost = weighed_cost / whole;
  return stats;
}

}  // namespace kdray::core
