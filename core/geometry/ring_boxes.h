// SPDX-License-Identifier: Apache-2.0
// A tree of boxes that finds the corners or edges of a shrinking ring that a triangle may meet.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <vector>

#include "core/geometry/cut_meter.h"
#include "core/geometry/predicates.h"
#include "core/geometry/ring.h"

namespace kdray::core {

/// A triangle a, b, c, counterclockwise.
using Triangle2 = std::array<Point2, 3>;

/// A tree of boxes over the corners of a ring, or over its edges. Corners may be removed.
class RingBoxes {
 public:
  enum class Over { kCorners, kEdges };

  /// The ring must outlive this object.
  RingBoxes(const Ring* ring, CutMeter* meter) : ring_(ring), meter_(meter) {}

  /// Rebuilds the tree over these corners, or over the edges that begin there. O(n log n).
  /// Empty if the meter stops.
  void Build(std::vector<std::uint32_t> corners, Over over);
  std::size_t built_size() const { return corners_.size(); }
  void Clear();

  /// Must be called after corner i was removed from the ring; `before` is the corner before it.
  /// O(log n).
  void Remove(std::uint32_t i, std::uint32_t before);

  /// Calls visit(i) for every corner i in the closed triangle, or every edge i that meets it, and
  /// for some others. Those near the triangle's second corner come first, by the order of boxes.
  /// Ends when visit returns true or the meter stops.
  template <class F>
  void Visit(const Triangle2& triangle, F&& visit) const;

 private:
  struct Box {
    Point2 min, max;
  };
  struct Node {
    Box box;
    std::uint32_t parent = 0;
    std::uint32_t first = 0;  // index of its first corner, or of the first of its two children
    std::int32_t count = 0;   // remaining corners, or kInner
  };
  static constexpr std::int32_t kInner = -1;
  static constexpr std::uint32_t kLeafCorners = 8;

  Box BoxOf(std::uint32_t i) const;
  Box LeafBox(const Node& leaf) const;
  static Box Empty();
  static Box Union(const Box& a, const Box& b);
  static bool Overlap(const Box& a, const Box& b);
  static bool IsOutside(const Triangle2& triangle, const Box& box);
  static double Distance(Point2 p, const Box& box);
  void Refit(std::uint32_t leaf);

  const Ring* ring_;
  CutMeter* meter_;
  std::vector<Node> nodes_;
  Over over_ = Over::kCorners;
  std::vector<std::uint32_t> corners_;
  std::vector<std::uint32_t> leaf_of_;  // by corner
};

template <class F>
void RingBoxes::Visit(const Triangle2& triangle, F&& visit) const {
  if (nodes_.empty()) return;
  const auto [a, b, c] = triangle;
  const Box bounds = {{std::min({a.x, b.x, c.x}), std::min({a.y, b.y, c.y})},
                      {std::max({a.x, b.x, c.x}), std::max({a.y, b.y, c.y})}};
  std::array<std::uint32_t, 64> stack;  // the tree is balanced: at most 32 levels
  std::size_t depth = 0;
  stack[depth++] = 0;
  while (depth > 0) {
    const Node& node = nodes_[stack[--depth]];
    if (node.count == kInner) {
      if (meter_->Spend(50)) return;
      std::array<std::uint32_t, 2> children = {node.first, node.first + 1};
      if (Distance(b, nodes_[children[0]].box) < Distance(b, nodes_[children[1]].box)) {
        std::swap(children[0], children[1]);
      }
      for (const std::uint32_t child : children) {
        const Box& box = nodes_[child].box;
        if (Overlap(box, bounds) && !IsOutside(triangle, box)) stack[depth++] = child;
      }
      continue;
    }
    if (meter_->Spend(20 * static_cast<std::uint64_t>(node.count))) return;
    for (std::int32_t k = 0; k < node.count; ++k) {
      const std::uint32_t corner = corners_[node.first + static_cast<std::uint32_t>(k)];
      if (Overlap(BoxOf(corner), bounds) && visit(corner)) return;
    }
  }
}

}  // namespace kdray::core
