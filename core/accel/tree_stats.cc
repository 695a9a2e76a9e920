// SPDX-License-Identifier: Apache-2.0
#include "core/accel/tree_stats.h"

#include <algorithm>

namespace kdray::core {

void CountLeaf(std::size_t triangles, std::uint32_t depth, TreeStats* stats) {
  ++stats->leaves;
  if (triangles == 0) ++stats->empty_leaves;
  stats->references += triangles;
  stats->max_depth = std::max(stats->max_depth, depth);
  stats->max_leaf = std::max<std::uint64_t>(stats->max_leaf, triangles);
  const std::size_t entry = std::min(triangles, TreeStats::kHistogramLeaf + 1);
  if (stats->leaf_histogram.size() <= entry) stats->leaf_histogram.resize(entry + 1);
  ++stats->leaf_histogram[entry];
}

}  // namespace kdray::core
