// SPDX-License-Identifier: Apache-2.0
// The surface area heuristic: the expected cost of a random ray in a node.
#pragma once

#include <cstddef>

#include "core/base/float4.h"

namespace kdray::core {

/// The cost model of the SAH builds; unit: one traversal step. A leaf is tested in blocks of
/// triangles, so a partly filled block costs as much as a full one. Source: MacDonald and Booth,
/// "Heuristics for ray tracing using space subdivision", 1990; Wald and Havran, "On building fast
/// kd-Trees for Ray Tracing, and on doing that in O(N log N)", 2006, section 3.
struct SahCost {
  static constexpr std::size_t kBlock = 8;  ///< triangles that are tested at once

  double traversal = 1;  ///< of an interior node; a larger value gives fewer, fuller leaves
  double intersection =
      4;  ///< of a block; a larger value gives more, emptier leaves and more memory
  double empty_bonus = 0.8;  ///< factor for a split that leaves one side empty, <= 1; a smaller
                             ///< value cuts off empty space earlier

  /// The constants for a mesh of this size. Measured (docs/experiments/kd_builders.md): a large
  /// mesh does not fit the caches, so memory matters more than saved tests.
  static SahCost For(std::size_t triangles) {
    constexpr std::size_t kLargeMesh = 200'000;
    SahCost cost;
    if (triangles > kLargeMesh) cost.intersection = 2;
    return cost;
  }

  /// A leaf with this many triangles.
  double Leaf(std::size_t triangles) const {
    const std::size_t blocks = (triangles + kBlock - 1) / kBlock;
    return intersection * static_cast<double>(blocks);
  }

  /// A subtree with this many triangles, which may be split further. Up to two blocks it costs as a
  /// leaf. Beyond that, the cost has no steps: with steps, planes would go to positions that leave
  /// whole blocks, although both children are split again.
  double Subtree(std::size_t triangles) const {
    if (triangles <= 2 * kBlock) return Leaf(triangles);
    return intersection * static_cast<double>(triangles + kBlock - 1) / kBlock;
  }

  /// Subtree() of four counts at once; unit: an eighth of a block's cost. Exact up to 2^24.
  static Float4 SubtreeEighths(Int4 triangles) {
    static_assert(kBlock == 8);
    return ToFloat4((triangles + 7) & ((triangles > 16) | ~7));
  }

  /// A node with two children. A ray through the node meets each child with the given probability.
  double Split(double first_probability, std::size_t first_triangles, double second_probability,
               std::size_t second_triangles) const {
    const double cost = traversal + first_probability * Subtree(first_triangles) +
                        second_probability * Subtree(second_triangles);
    return first_triangles == 0 || second_triangles == 0 ? empty_bonus * cost : cost;
  }
};

}  // namespace kdray::core
