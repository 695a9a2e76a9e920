// SPDX-License-Identifier: Apache-2.0
#include "core/accel/kdtree/kd_tree.h"

#include <string>

#include "core/accel/kdtree/split.h"
#include "core/base/cancel_poll.h"

namespace kdray::core {

Result<std::vector<TreeCell>> KdTree::Cells(std::uint32_t depth, std::size_t limit,
                                            const CancelToken& cancel) const {
  struct Entry {
    std::uint32_t node;
    std::uint32_t depth;
    Bounds3f cell;
  };
  std::vector<TreeCell> cells;
  if (bounds.IsEmpty()) return cells;

  // In the depth-first layout, the leaves below a node are one range of nodes, up to `end`, so sums
  // need no second walk.
  CancelPoll poll(cancel);
  std::vector<Entry> pending = {{0, 0, bounds}};
  while (!pending.empty()) {
    if (poll.Spend(16)) return poll.ToError();
    const Entry entry = pending.back();
    pending.pop_back();
    const KdNode& node = nodes[entry.node];
    if (!node.IsLeaf() && entry.depth < depth) {
      const SplitPlane plane{node.axis(), node.split()};
      pending.push_back({node.above_child(), entry.depth + 1, plane.AboveCell(entry.cell)});
      pending.push_back({entry.node + 1, entry.depth + 1, plane.BelowCell(entry.cell)});
      continue;
    }
    if (cells.size() == limit) {
      return Error{ErrorCode::kInvalidArgument, "more than " + std::to_string(limit) +
                                                    " cells at depth " + std::to_string(depth)};
    }
    const std::uint32_t end =
        pending.empty() ? static_cast<std::uint32_t>(nodes.size()) : pending.back().node;
    std::uint64_t triangles = 0;
    PolledLoop(end - entry.node, 2, &poll, [&](std::size_t i) {
      const KdNode& below = nodes[entry.node + i];
      if (below.IsLeaf()) triangles += below.primitive_count();
    });
    cells.push_back({Bounds3d{Vec3d(entry.cell.min), Vec3d(entry.cell.max)}, entry.depth,
                     node.IsLeaf(), triangles});
  }
  if (poll.stopped()) return poll.ToError();
  return cells;
}

}  // namespace kdray::core
