// SPDX-License-Identifier: Apache-2.0
// Statistics of a kd-tree.
#pragma once

#include "core/accel/kdtree/kd_tree.h"
#include "core/accel/sah_cost.h"
#include "core/accel/tree_stats.h"

namespace kdray::core {

/// Counts and the expected cost of a random ray, from one walk over the finished tree. Each
/// interior node costs a traversal step, each leaf its triangles, weighted by the probability that
/// a ray through the tree's bounds meets its cell. O(nodes). Unspecified if `cancel` stops.
TreeStats ComputeStats(const KdTree& tree, const SahCost& cost, const CancelToken& cancel = {});

}  // namespace kdray::core
