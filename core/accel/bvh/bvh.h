// SPDX-License-Identifier: Apache-2.0
// A binary bounding volume hierarchy.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <span>
#include <utility>
#include <vector>

#include "core/accel/tree_cell.h"
#include "core/base/cancel.h"
#include "core/geometry/bounds3.h"
#include "core/geometry/hit.h"
#include "core/geometry/local_ray.h"

namespace kdray::core {

/// 32 bytes. Interior: primitive_count 0, the first child is the next node in memory, the second at
/// `offset`. Leaf: primitives [offset, offset + primitive_count).
struct BvhNode {
  Bounds3f bounds;  ///< of the triangles below, rounded outward
  std::uint32_t offset = 0;
  std::uint32_t primitive_count = 0;
  bool IsLeaf() const { return primitive_count != 0; }
};
static_assert(sizeof(BvhNode) == 32);

/// Immutable once built; safe from many threads at once. Coordinates are the mesh's local ones.
struct Bvh {
  static constexpr int kMaxDepth = 64;

  std::vector<BvhNode>
      nodes;  ///< depth first; [0] is the root; empty if all triangles are degenerate
  std::vector<PrimitiveId> primitives;

  std::uint64_t bytes() const {
    return nodes.size() * sizeof(BvhNode) + primitives.size() * sizeof(PrimitiveId);
  }

  /// As KdTree::Traverse; leaves come roughly front to back.
  template <class Visit, class OnNode>
  void Traverse(const LocalRay& ray, double pad, const Visit& visit, const OnNode& on_node) const;

  /// As KdTree::Cells.
  Result<std::vector<TreeCell>> Cells(std::uint32_t depth, std::size_t limit,
                                      const CancelToken& cancel = {}) const;
};

template <class Visit, class OnNode>
void Bvh::Traverse(const LocalRay& ray, double pad, const Visit& visit,
                   const OnNode& on_node) const {
  if (nodes.empty()) return;
  struct StackEntry {
    std::uint32_t node;
    double enter;
  };
  std::array<StackEntry, kMaxDepth> stack;
  int stack_size = 0;
  const LocalInterval search = SearchInterval(ray);
  double limit = std::numeric_limits<double>::infinity();

  const auto clip = [&](std::uint32_t index) {
    const Bounds3f& b = nodes[index].bounds;
    LocalInterval interval = ClipToBox(ray, Bounds3d{Vec3d(b.min), Vec3d(b.max)}, pad, search);
    interval.exit = std::min(interval.exit, limit);
    return interval;
  };

  std::uint32_t current = 0;
  if (clip(0).IsEmpty()) return;
  for (;;) {
    if (!on_node()) return;
    const BvhNode& node = nodes[current];
    if (!node.IsLeaf()) {
      std::uint32_t near_child = current + 1;
      std::uint32_t far_child = node.offset;
      LocalInterval near_interval = clip(near_child);
      LocalInterval far_interval = clip(far_child);
      if (!far_interval.IsEmpty() &&
          (near_interval.IsEmpty() || far_interval.enter < near_interval.enter)) {
        std::swap(near_child, far_child);
        std::swap(near_interval, far_interval);
      }
      if (!near_interval.IsEmpty()) {
        if (!far_interval.IsEmpty())
          stack[static_cast<std::size_t>(stack_size++)] = {far_child, far_interval.enter};
        current = near_child;
        continue;
      }
    } else {
      limit = visit(
          std::span<const PrimitiveId>(primitives).subspan(node.offset, node.primitive_count));
    }
    do {
      if (stack_size == 0) return;
      --stack_size;
      current = stack[static_cast<std::size_t>(stack_size)].node;
    } while (stack[static_cast<std::size_t>(stack_size)].enter > limit);
  }
}

}  // namespace kdray::core
