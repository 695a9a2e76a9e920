// SPDX-License-Identifier: Apache-2.0
#include "core/accel/bvh/bvh.h"

#include <string>

#include "core/base/cancel_poll.h"

namespace kdray::core {

Result<std::vector<TreeCell>> Bvh::Cells(std::uint32_t depth, std::size_t limit,
                                         const CancelToken& cancel) const {
  struct Entry {
    std::uint32_t node;
    std::uint32_t depth;
  };
  std::vector<TreeCell> cells;
  if (nodes.empty()) return cells;

  // In the depth-first layout, the leaves below a node are one range of nodes.
  CancelPoll poll(cancel);
  std::vector<Entry> pending = {{0, 0}};
  while (!pending.empty()) {
    if (poll.Spend(16)) return poll.ToError();
    const Entry entry = pending.back();
    pending.pop_back();
    const BvhNode& node = nodes[entry.node];
    if (!node.IsLeaf() && entry.depth < depth) {
      pending.push_back({node.offset, entry.depth + 1});
      pending.push_back({entry.node + 1, entry.depth + 1});
      continue;
    }
    if (cells.size() == limit) {
      return Error{ErrorCode::kInvalidArgument, "more than " + std::to_string(limit) +
                                                    " cells at depth " + std::to_string(depth)};
    }
    const std::size_t end = pending.empty() ? nodes.size() : pending.back().node;
    std::uint64_t triangles = 0;
    PolledLoop(end - entry.node, 2, &poll,
               [&](std::size_t i) { triangles += nodes[entry.node + i].primitive_count; });
    cells.push_back({Bounds3d{Vec3d(node.bounds.min), Vec3d(node.bounds.max)}, entry.depth,
                     node.IsLeaf(), triangles});
  }
  if (poll.stopped()) return poll.ToError();
  return cells;
}

}  // namespace kdray::core
