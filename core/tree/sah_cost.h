// The surface area heuristic: what a random ray is expected to pay in a node.
#pragma once

#include <cstddef>

namespace kdray::core {

/// The cost model of the SAH builds; unit: one traversal step. Source: MacDonald and Booth,
/// "Heuristics for ray tracing using space subdivision", 1990; Wald and Havran, "On building fast
/// kd-Trees for Ray Tracing, and on doing that in O(N log N)", 2006, section 3.
struct SahCost {
  double traversal = 1;  ///< of an interior node; larger: fewer, fuller leaves
  /// Of a triangle; larger: more, emptier leaves and more memory. Less than a step, since a step
  /// waits for memory more often: from 0.4 to 2.5 rays are equally fast, but the tree of the bunny
  /// (69,451 triangles) takes 26 to 66 bytes a triangle.
  double intersection = 0.7;
  double empty_bonus = 0.8;  ///< factor for a split that leaves one side empty, <= 1; smaller:
                             ///< empty space is cut off earlier

  /// A leaf with so many triangles.
  double Leaf(std::size_t triangles) const { return intersection * static_cast<double>(triangles); }

  /// A node whose children are leaves. A ray through the node meets each child with the given
  /// probability.
  double Split(double first_probability, std::size_t first_triangles, double second_probability,
               std::size_t second_triangles) const {
    const double cost = traversal + first_probability * Leaf(first_triangles) +
                        second_probability * Leaf(second_triangles);
    return first_triangles == 0 || second_triangles == 0 ? empty_bonus * cost : cost;
  }
};

}  // namespace kdray::core
