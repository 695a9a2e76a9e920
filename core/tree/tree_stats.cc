#include "core/tree/tree_stats.h"

#include <algorithm>

namespace kdray::core {

void CountLeaf(std::size_t triangles, std::uint32_t depth, TreeStats* stats) {
  ++stats->leaves;
  if (triangles == 0) ++stats->empty_leaves;
  stats->references += triangles;
  stats->max_depth = std::max(stats->max_depth, depth);
  if (stats->leaf_histogram.size() <= triangles) stats->leaf_histogram.resize(triangles + 1);
  ++stats->leaf_histogram[triangles];
}

}  // namespace kdray::core
