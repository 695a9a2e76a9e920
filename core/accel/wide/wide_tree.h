// SPDX-License-Identifier: Apache-2.0
// The form of every structure in which it is traversed: the same tree with up to eight children per
// node, laid out for SIMD. core/accel/wide/collapse.h makes it; the kernels (core/kernel) know no
// other form.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "core/base/cancel.h"
#include "core/base/cancel_poll.h"
#include "core/base/huge_pages.h"
#include "core/base/result.h"
#include "core/geometry/bounds3.h"
#include "core/geometry/hit.h"
#include "core/geometry/local_ray.h"

namespace kdray::core {

/// The enlargement of every box of a wide tree, on each side: the pad of the fat ray (kFloatPad),
/// and the error of a box test in float. With |origin| <= 4, |box| <= 1, the reciprocal and the
/// origin rounded once, t = bound * inverse - origin * inverse is off by less than 21 * 2^-24 in
/// space along its axis, fused or not; this is 32 * 2^-24. So box tests in float need no other pad.
inline constexpr double kWidePad = kFloatPad + 0x1p-19;

/// The kinds of a child: an interior node, a leaf or empty.
class WideChild {
 public:
  static constexpr std::uint32_t kLeafBit = 0x80000000u;
  static constexpr std::uint32_t kEmpty = 0xffffffffu;
  static constexpr std::uint32_t kMaxIndex = 0x7ffffffeu;
};

/// Up to eight cells. For a kd-tree they are disjoint, each reduced to the bounds of its triangles,
/// and `order` is exact; for other structures `order` is approximate.
struct alignas(64) WideNode {
  static constexpr std::size_t kWidth = 8;
  float low[3][kWidth];
  float high[3][kWidth];
  /// A node's number; or kLeafBit and the number of a leaf's first block; or kEmpty, whose box is
  /// inverted and infinite.
  std::uint32_t child[kWidth];
  /// [octant]: the children back to front, four bits each, for rays whose direction is negative
  /// along x, y, z where bits 0, 1, 2 of the octant are set.
  std::uint32_t order[kWidth];
};
static_assert(sizeof(WideNode) == 256);

/// Eight triangles of a leaf. Corners are the mesh's local ones, rounded to float. Lanes without a
/// triangle have NaN corners, which no test accepts.
struct alignas(64) LeafBlock {
  static constexpr std::size_t kWidth = 8;
  static constexpr unsigned kAllLanes = (1u << kWidth) - 1;
  static constexpr std::uint32_t kLast = 0x80000000u;  ///< in id[0]: the leaf ends here
  static constexpr std::uint32_t kIdMask = 0x7fffffffu;
  float corner[3][3][kWidth];  ///< [corner][axis][lane]
  std::uint32_t id[kWidth];    ///< kIdMask in a lane without a triangle

  bool IsLast() const { return (id[0] & kLast) != 0; }
  PrimitiveId IdOf(std::size_t lane) const { return id[lane] & kIdMask; }
};
static_assert(sizeof(LeafBlock) == 320);

/// Immutable once built; safe from many threads at once. Coordinates are the mesh's local ones.
struct WideTree {
  Bounds3f bounds =
      Bounds3f::Empty();  ///< of all triangles, kWidePad larger; empty without triangles
  std::uint32_t root = WideChild::kEmpty;  ///< as WideNode::child
  std::uint32_t stack_size =
      0;                       ///< stack entries of a traversal that pushes all children of a node
  HugeVector<WideNode> nodes;  ///< parents before their children
  HugeVector<LeafBlock> blocks;

  std::uint64_t bytes() const {
    return nodes.size() * sizeof(WideNode) + blocks.size() * sizeof(LeafBlock);
  }

  /// Walks the leaves that the fat ray meets, roughly front to back: the plain form of every
  /// kernel, for one ray and in double. visit(span<const PrimitiveId>) tests a block's triangles
  /// and returns the local parameter beyond which the caller needs nothing more, as in
  /// KdTree::Traverse. go_on() is called before each node and each block, and ends the walk by
  /// returning false.
  template <class Visit, class GoOn>
  void Traverse(const LocalRay& ray, double pad, const Visit& visit, const GoOn& go_on) const;

  /// kCorrupt unless every child is in range and follows its parent, leaves end, ids are below
  /// triangle_count, orders are permutations and the stack is large enough: what a traversal relies
  /// on. For trees read from disk. Also kCancelled and kDeadlineExceeded.
  Status Validate(std::size_t triangle_count, const CancelToken& cancel = {}) const;
};

template <class Visit, class GoOn>
void WideTree::Traverse(const LocalRay& ray, double pad, const Visit& visit,
                        const GoOn& go_on) const {
  // The boxes are padded already; only a larger `pad` needs more (ExactIntersection::pad).
  const double more = std::max(0.0, pad - kFloatPad);
  double limit = std::numeric_limits<double>::infinity();
  const LocalInterval search = SearchInterval(ray);
  const auto enters = [&](const Bounds3d& box) {
    LocalInterval interval = ClipToBox(ray, box, more, search);
    interval.exit = std::min(interval.exit, limit);
    return interval.IsEmpty() ? std::numeric_limits<double>::infinity() : interval.enter;
  };
  constexpr double kInf = std::numeric_limits<double>::infinity();
  if (root == WideChild::kEmpty) return;
  if (enters({Vec3d(bounds.min), Vec3d(bounds.max)}) == kInf) return;

  unsigned octant = 0;
  for (int axis = 0; axis < 3; ++axis) {
    octant |= static_cast<unsigned>(ray.direction[axis] < 0) << axis;
  }
  struct Entry {
    double enter;
    std::uint32_t child;
  };
  std::vector<Entry> stack = {{-kInf, root}};
  while (!stack.empty()) {
    const Entry entry = stack.back();
    stack.pop_back();
    if (entry.enter > limit) continue;
    if ((entry.child & WideChild::kLeafBit) == 0) {
      if (!go_on()) return;
      const WideNode& node = nodes[entry.child];
      for (std::size_t i = 0; i < WideNode::kWidth; ++i) {
        const std::size_t c = node.order[octant] >> (4 * i) & 7u;
        if (node.child[c] == WideChild::kEmpty) continue;
        Bounds3d box;
        for (int axis = 0; axis < 3; ++axis) {
          box.min[axis] = static_cast<double>(node.low[axis][c]);
          box.max[axis] = static_cast<double>(node.high[axis][c]);
        }
        const double enter = enters(box);
        if (enter != kInf) stack.push_back({enter, node.child[c]});
      }
      continue;
    }
    for (std::size_t b = entry.child & ~WideChild::kLeafBit;; ++b) {
      if (!go_on()) return;
      std::array<PrimitiveId, LeafBlock::kWidth> ids;
      std::size_t size = 0;
      for (std::size_t lane = 0; lane < LeafBlock::kWidth; ++lane) {
        if (blocks[b].IdOf(lane) != LeafBlock::kIdMask) ids[size++] = blocks[b].IdOf(lane);
      }
      limit = visit(std::span<const PrimitiveId>(ids.data(), size));
      if (blocks[b].IsLast()) break;
    }
  }
}

/// The largest number of stack entries of a traversal of these nodes. Children must follow their
/// parents. Means nothing once the poll has stopped.
std::uint32_t StackSize(const WideTree& tree, CancelPoll* poll);

}  // namespace kdray::core
