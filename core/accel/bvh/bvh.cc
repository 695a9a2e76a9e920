#include "core/accel/bvh/bvh.h"

#include <string>

#include "core/base/cancel_poll.h"

namespace kdray::core {

namespace {

Error Corrupt(std::size_t node, const char* what) {
  return {ErrorCode::kCorrupt, "bvh node " + std::to_string(node) + ": " + what};
}

}  // namespace

Status Bvh::Validate(std::size_t triangle_count) const {
  for (const PrimitiveId id : primitives) {
    if (id >= triangle_count) {
      return Error{ErrorCode::kCorrupt, "the bvh names triangle " + std::to_string(id) + " of " +
                                            std::to_string(triangle_count)};
    }
  }
  if (nodes.empty()) return {};

  // The layout is depth first: the first child comes next, the second after the whole first
  // subtree.
  struct PendingSecond {
    std::uint32_t node;
    int depth;
  };
  std::vector<PendingSecond> pending;
  int depth = 0;
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    const BvhNode& node = nodes[i];
    if (node.bounds.IsEmpty() || !IsFinite(node.bounds.Extent())) {
      return Corrupt(i, "its bounds are invalid");
    }
    if (!node.IsLeaf()) {
      if (++depth > kMaxDepth) return Corrupt(i, "too deep");
      pending.push_back({node.offset, depth});
      continue;
    }
    if (std::uint64_t{node.offset} + node.primitive_count > primitives.size()) {
      return Corrupt(i, "the leaf reaches beyond the last primitive");
    }
    if (pending.empty()) {
      if (i + 1 != nodes.size()) return Corrupt(i + 1, "belongs to no parent");
      return {};
    }
    if (pending.back().node != i + 1) {
      return Corrupt(i + 1, "is not the second child that its parent names");
    }
    depth = pending.back().depth;
    pending.pop_back();
  }
  return Error{ErrorCode::kCorrupt, "the bvh ends within a node's children"};
}

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
