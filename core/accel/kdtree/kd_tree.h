// SPDX-License-Identifier: Apache-2.0
// The kd-tree of all four kd builds, and its traversal (George Tang, "Acceleration Structures",
// 2019, Algorithm 2).
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "core/accel/kdtree/kd_node.h"
#include "core/accel/tree_cell.h"
#include "core/base/cancel.h"
#include "core/base/huge_pages.h"
#include "core/geometry/bounds3.h"
#include "core/geometry/hit.h"
#include "core/geometry/local_ray.h"

namespace kdray::core {

/// Immutable once built; safe from many threads at once. Coordinates are the mesh's local ones.
struct KdTree {
  /// The largest depth: builders stop there, and the traversal's stack has one entry per level.
  static constexpr int kMaxDepth = 64;

  Bounds3f bounds =
      Bounds3f::Empty();     ///< of all triangles in the tree, rounded outward; the root's cell
  HugeVector<KdNode> nodes;  ///< depth first; [0] is the root; never empty
  HugeVector<PrimitiveId> primitives;  ///< the leaves' triangles

  /// For each node, tighter bounds than its cell: the union, over the leaves below, of the bounds
  /// of each triangle clipped to the leaf's cell; empty without triangles. Every common point of a
  /// triangle and the closed cell of a leaf that names it lies in the bounds of the leaf and of all
  /// nodes above it. Not stored on disk; may be dropped (then empty).
  HugeVector<Bounds3f> node_bounds;

  std::uint64_t bytes() const {
    return nodes.size() * sizeof(KdNode) + node_bounds.size() * sizeof(Bounds3f) +
           primitives.size() * sizeof(PrimitiveId);
  }

  /// Walks the leaves that the fat ray meets, front to back. visit(span<const PrimitiveId>) tests a
  /// leaf's triangles and returns the local parameter beyond which the caller needs nothing more
  /// (infinity: go on; -infinity: stop). Leaves that begin exactly there are still visited: a
  /// triangle of equal t and smaller id may lie in them. `on_node()` is called once per node
  /// visited, and ends the walk by returning false. Source: lecture note, Algorithm 2; Havran,
  /// Kopal, Bittner, Zara, "Fast Robust BSP Tree Traversal Algorithm for Ray Tracing", JGT 2(4),
  /// 1997, for the cases it leaves open (direction parallel to the plane, origin on it).
  template <class Visit, class OnNode>
  void Traverse(const LocalRay& ray, double pad, const Visit& visit, const OnNode& on_node) const;

  /// The nodes at `depth` and the leaves above it, depth first; kInvalidArgument if there are more
  /// than `limit`. Errors: kCancelled, kDeadlineExceeded. O(nodes).
  Result<std::vector<TreeCell>> Cells(std::uint32_t depth, std::size_t limit,
                                      const CancelToken& cancel = {}) const;
};

template <class Visit, class OnNode>
void KdTree::Traverse(const LocalRay& ray, double pad, const Visit& visit,
                      const OnNode& on_node) const {
  struct StackEntry {
    std::uint32_t node;
    LocalInterval interval;
  };
  std::array<StackEntry, kMaxDepth> stack;
  int stack_size = 0;

  LocalInterval interval =
      ClipToBox(ray, Bounds3d{Vec3d(bounds.min), Vec3d(bounds.max)}, pad, SearchInterval(ray));
  if (interval.IsEmpty()) return;
  double limit = std::numeric_limits<double>::infinity();
  std::uint32_t current = 0;

  for (;;) {
    if (!on_node()) return;
    const KdNode node = nodes[current];
    if (!node.IsLeaf()) {
      const int axis = node.axis();
      const double to_plane = static_cast<double>(node.split()) - ray.origin[axis];
      const double inverse = ray.inverse[axis];
      const std::uint32_t below = current + 1;
      const std::uint32_t above = node.above_child();

      if (inverse == 0) {
        // Parallel to the plane: one side, or both when the fat ray touches it.
        if (to_plane > pad) {
          current = below;
        } else if (to_plane < -pad) {
          current = above;
        } else {
          stack[static_cast<std::size_t>(stack_size++)] = {above, interval};
          current = below;
        }
        continue;
      }

      const bool upward = inverse > 0;
      const std::uint32_t near_child = upward ? below : above;
      const std::uint32_t far_child = upward ? above : below;
      // The fat ray is in contact with the plane between `first` and `last`.
      const double at_plane = to_plane * inverse;
      const double half_width = pad * std::fabs(inverse);
      const double first = at_plane - half_width;
      const double last = at_plane + half_width;
      if (first > interval.exit) {
        current = near_child;  // Case 1: leaves the cell before the plane.
      } else if (last < interval.enter) {
        current = far_child;  // Case 2: enters the cell behind the plane.
      } else {
        // Case 3: crosses the plane inside the cell.
        stack[static_cast<std::size_t>(stack_size++)] = {
            far_child, {std::max(interval.enter, first), interval.exit}};
        current = near_child;
        interval.exit = std::min(interval.exit, last);
      }
      continue;
    }

    if (node.primitive_count() != 0) {
      limit = visit(std::span<const PrimitiveId>(primitives)
                        .subspan(node.first_primitive(), node.primitive_count()));
    }
    // Cells behind the limit hold nothing that matters. Entries are not sorted by `enter` once
    // cells are padded, so skip them one by one.
    do {
      if (stack_size == 0) return;
      --stack_size;
      current = stack[static_cast<std::size_t>(stack_size)].node;
      interval = stack[static_cast<std::size_t>(stack_size)].interval;
    } while (interval.enter > limit);
    interval.exit = std::min(interval.exit, limit);
  }
}

}  // namespace kdray::core
