// SPDX-License-Identifier: Apache-2.0
#include "core/geometry/ring_boxes.h"

#include <cstddef>
#include <limits>
#include <utility>

namespace kdray::core {

RingBoxes::Box RingBoxes::BoxOf(std::uint32_t i) const {
  const Point2 p = ring_->point(i);
  if (over_ == Over::kCorners) return {p, p};
  const Point2 q = ring_->point(ring_->next(i));
  return {{std::min(p.x, q.x), std::min(p.y, q.y)}, {std::max(p.x, q.x), std::max(p.y, q.y)}};
}

RingBoxes::Box RingBoxes::Empty() {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  return {{kInfinity, kInfinity}, {-kInfinity, -kInfinity}};
}

RingBoxes::Box RingBoxes::Union(const Box& a, const Box& b) {
  return {{std::min(a.min.x, b.min.x), std::min(a.min.y, b.min.y)},
          {std::max(a.max.x, b.max.x), std::max(a.max.y, b.max.y)}};
}

bool RingBoxes::Overlap(const Box& a, const Box& b) {
  return a.min.x <= b.max.x && b.min.x <= a.max.x && a.min.y <= b.max.y && b.min.y <= a.max.y;
}

// Whether the box lies outside of one edge of the triangle: its innermost corner does.
bool RingBoxes::IsOutside(const Triangle2& triangle, const Box& box) {
  for (std::size_t i = 0; i < 3; ++i) {
    const Point2 p = triangle[i];
    const Point2 q = triangle[(i + 1) % 3];
    const Point2 innermost = {q.y > p.y ? box.min.x : box.max.x, q.x > p.x ? box.max.y : box.min.y};
    if (Orient2d(p, q, innermost) < 0) return true;
  }
  return false;
}

double RingBoxes::Distance(Point2 p, const Box& box) {
  return std::max({box.min.x - p.x, p.x - box.max.x, 0.0}) +
         std::max({box.min.y - p.y, p.y - box.max.y, 0.0});
}

RingBoxes::Box RingBoxes::LeafBox(const Node& leaf) const {
  Box box = Empty();
  for (std::int32_t k = 0; k < leaf.count; ++k) {
    box = Union(box, BoxOf(corners_[leaf.first + static_cast<std::uint32_t>(k)]));
  }
  return box;
}

void RingBoxes::Clear() {
  nodes_.clear();
  corners_.clear();
}

void RingBoxes::Build(std::vector<std::uint32_t> corners, Over over) {
  corners_ = std::move(corners);
  over_ = over;
  leaf_of_.resize(ring_->size());
  const auto n = static_cast<std::uint32_t>(corners_.size());
  std::size_t leaves = 1;
  while (leaves * kLeafCorners < n) leaves *= 2;
  nodes_.reserve(2 * leaves - 1);
  nodes_.assign(1, Node{Empty(), 0, 0, static_cast<std::int32_t>(n)});
  // Nodes are split in the order of their creation, so children come after their parents.
  for (std::uint32_t i = 0; i < nodes_.size(); ++i) {
    const auto count = static_cast<std::uint32_t>(nodes_[i].count);
    const std::uint32_t first = nodes_[i].first;
    if (count <= kLeafCorners) {
      for (std::uint32_t k = first; k < first + count; ++k) leaf_of_[corners_[k]] = i;
      continue;
    }
    if (meter_->Spend(20 * std::uint64_t{count})) {
      Clear();  // not all corners have a leaf, and Remove() relies on it
      return;
    }
    const auto middle_of = [&](std::uint32_t corner, bool by_x) {
      const Box box = BoxOf(corner);
      // Halves first: the sum of two large numbers might overflow.
      return by_x ? box.min.x / 2 + box.max.x / 2 : box.min.y / 2 + box.max.y / 2;
    };
    Box middles = Empty();
    for (std::uint32_t k = first; k < first + count; ++k) {
      const Point2 middle = {middle_of(corners_[k], true), middle_of(corners_[k], false)};
      middles = Union(middles, {middle, middle});
    }
    const bool by_x = middles.max.x - middles.min.x >= middles.max.y - middles.min.y;
    const auto begin = corners_.begin() + first;
    std::nth_element(begin, begin + count / 2, begin + count,
                     [&](std::uint32_t a, std::uint32_t b) {
                       return std::pair(middle_of(a, by_x), a) < std::pair(middle_of(b, by_x), b);
                     });
    const auto child = static_cast<std::uint32_t>(nodes_.size());
    nodes_[i].first = child;
    nodes_[i].count = kInner;
    const auto half = static_cast<std::int32_t>(count / 2);
    nodes_.push_back({Empty(), i, first, half});
    nodes_.push_back({Empty(), i, first + count / 2, static_cast<std::int32_t>(count) - half});
  }
  for (std::size_t i = nodes_.size(); i-- > 0;) {
    Node& node = nodes_[i];
    node.box = node.count == kInner ? Union(nodes_[node.first].box, nodes_[node.first + 1].box)
                                    : LeafBox(node);
  }
}

void RingBoxes::Remove(std::uint32_t i, std::uint32_t before) {
  if (nodes_.empty()) return;
  Node& leaf = nodes_[leaf_of_[i]];
  const auto begin = corners_.begin() + leaf.first;
  *std::find(begin, begin + leaf.count, i) = *(begin + leaf.count - 1);
  --leaf.count;
  Refit(leaf_of_[i]);
  if (over_ == Over::kEdges) Refit(leaf_of_[before]);
}

void RingBoxes::Refit(std::uint32_t leaf) {
  nodes_[leaf].box = LeafBox(nodes_[leaf]);
  for (std::uint32_t i = leaf; i != 0;) {
    i = nodes_[i].parent;
    nodes_[i].box = Union(nodes_[nodes_[i].first].box, nodes_[nodes_[i].first + 1].box);
  }
}

}  // namespace kdray::core
