// SPDX-License-Identifier: Apache-2.0
// Eight bytes of kd-tree: an interior node or a leaf. The bit packing stays in here.
#pragma once

#include <bit>
#include <cassert>
#include <cstdint>

namespace kdray::core {

/// Interior: a split plane; the below child is the next node in memory, the above child is at
/// above_child(). Leaf: a range of KdTree::primitives.
class KdNode {
 public:
  /// Child and primitive positions share their word with two bits of kind.
  static constexpr std::uint32_t kMaxIndex = (1u << 30) - 1;

  static KdNode Interior(int axis, float split, std::uint32_t above_child) {
    assert(axis >= 0 && axis < 3 && above_child <= kMaxIndex);
    return KdNode(std::bit_cast<std::uint32_t>(split),
                  above_child << 2 | static_cast<std::uint32_t>(axis));
  }
  static KdNode Leaf(std::uint32_t first_primitive, std::uint32_t primitive_count) {
    assert(primitive_count <= kMaxIndex);
    return KdNode(first_primitive, primitive_count << 2 | kLeafTag);
  }

  bool IsLeaf() const { return (tagged_ & 3u) == kLeafTag; }
  int axis() const { return static_cast<int>(tagged_ & 3u); }
  float split() const { return std::bit_cast<float>(payload_); }
  std::uint32_t above_child() const { return tagged_ >> 2; }
  std::uint32_t first_primitive() const { return payload_; }
  std::uint32_t primitive_count() const { return tagged_ >> 2; }

  KdNode() : KdNode(0, kLeafTag) {}  ///< an empty leaf
  friend bool operator==(const KdNode&, const KdNode&) = default;

 private:
  static constexpr std::uint32_t kLeafTag = 3;
  KdNode(std::uint32_t payload, std::uint32_t tagged) : payload_(payload), tagged_(tagged) {}

  std::uint32_t payload_;  // split position, or first primitive
  std::uint32_t tagged_;   // low two bits: axis, or kLeafTag; rest: above child, or primitive count
};
static_assert(sizeof(KdNode) == 8);

}  // namespace kdray::core
