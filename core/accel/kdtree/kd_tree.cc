#include "core/accel/kdtree/kd_tree.h"

#include <cmath>
#include <string>

#include "core/accel/kdtree/split.h"
#include "core/base/cancel_poll.h"

namespace kdray::core {

namespace {

// An entry of the stack that walks KdTree::nodes, one per level: a node's below child comes next,
// its above child after the whole below subtree.
struct PendingAbove {
  std::uint32_t node;
  std::uint32_t depth;
};

Error Corrupt(std::size_t node, const char* what) {
  return {ErrorCode::kCorrupt, "kd-tree node " + std::to_string(node) + ": " + what};
}

}  // namespace

Status KdTree::Validate(std::size_t triangle_count) const {
  const Vec3f sizes = bounds.Extent();
  const bool no_triangles = bounds == Bounds3f::Empty();
  if (!no_triangles && (bounds.IsEmpty() || !IsFinite(sizes))) {
    return Error{ErrorCode::kCorrupt, "the bounds of the kd-tree are invalid"};
  }
  for (const PrimitiveId id : primitives) {
    if (id >= triangle_count) {
      return Error{ErrorCode::kCorrupt, "the kd-tree names triangle " + std::to_string(id) +
                                            " of " + std::to_string(triangle_count)};
    }
  }

  std::vector<PendingAbove> pending;
  std::uint32_t depth = 0;
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    const KdNode& node = nodes[i];
    if (!node.IsLeaf()) {
      if (!std::isfinite(node.split())) return Corrupt(i, "the split plane is not finite");
      if (++depth > static_cast<std::uint32_t>(kMaxDepth)) return Corrupt(i, "too deep");
      pending.push_back({node.above_child(), depth});
      continue;
    }
    const std::uint64_t end = std::uint64_t{node.first_primitive()} + node.primitive_count();
    if (end > primitives.size()) return Corrupt(i, "the leaf reaches beyond the last primitive");
    if (pending.empty()) {
      if (i + 1 != nodes.size()) return Corrupt(i + 1, "belongs to no parent");
      return {};
    }
    if (pending.back().node != i + 1) {
      return Corrupt(i + 1, "is not the above child that its parent names");
    }
    depth = pending.back().depth;
    pending.pop_back();
  }
  return Error{ErrorCode::kCorrupt, "the kd-tree ends within a node's children"};
}

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
