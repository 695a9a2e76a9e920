// SPDX-License-Identifier: Apache-2.0
// Statistics of a built tree, for tests, benchmarks and callers.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace kdray::core {

struct TreeStats {
  /// The largest leaf that leaf_histogram counts in an entry of its own.
  static constexpr std::size_t kHistogramLeaf = 64;

  std::uint64_t nodes = 0;   ///< interior nodes and leaves
  std::uint64_t leaves = 0;  ///< empty ones included
  std::uint64_t empty_leaves = 0;
  std::uint64_t references = 0;  ///< triangles in all leaves; one triangle may be in several
  std::uint32_t max_depth = 0;   ///< of the binary tree; the root has depth 0
  /// [n] = leaves with n triangles, n <= kHistogramLeaf; [kHistogramLeaf + 1] = all larger leaves.
  /// Ends with the entry of the largest leaf.
  std::vector<std::uint64_t> leaf_histogram;
  std::uint64_t max_leaf = 0;  ///< triangles of the largest leaf
  std::uint64_t bytes = 0;     ///< memory of the tree without vertices and indices
  double sah_cost =
      0;  ///< expected cost of a random ray that crosses the bounds, in traversal steps
  double traversal_cost =
      0;  ///< the constants of the model (SahCost) with which sah_cost was computed
  double intersection_cost = 0;  ///< of a block of up to SahCost::kBlock triangles
  friend bool operator==(const TreeStats&, const TreeStats&) = default;
};

/// Counts one leaf into `stats` (leaves, empty_leaves, references, leaf_histogram, max_leaf,
/// max_depth).
void CountLeaf(std::size_t triangles, std::uint32_t depth, TreeStats* stats);

}  // namespace kdray::core
