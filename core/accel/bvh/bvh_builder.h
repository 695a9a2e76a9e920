// SPDX-License-Identifier: Apache-2.0
// Builds a Bvh by the binned surface area heuristic.
#pragma once

#include "core/accel/build_options.h"
#include "core/accel/bvh/bvh.h"
#include "core/accel/sah_cost.h"
#include "core/accel/tree_stats.h"
#include "core/base/result.h"
#include "core/geometry/triangle_mesh.h"

namespace kdray::core {

/// The hierarchy over the mesh's non-degenerate triangles, each in exactly one leaf; no nodes when
/// there are none. Splits between 16 bins of box centres; a node that no split makes cheaper is a
/// leaf, however large; deep nodes are halved by number, so that the depth stays within
/// Bvh::kMaxDepth. In parallel within the caller's arena, with the same result for every number of
/// threads. Errors: kCancelled, kDeadlineExceeded. O(n log n) time. Source: Wald, "On fast
/// Construction of SAH-based Bounding Volume Hierarchies", 2007.
Result<Bvh> BuildBvh(const TriangleMesh& mesh, const SahCost& cost, const BuildOptions& options);

/// As for the kd-tree: see core/accel/kdtree/kd_tree_stats.h.
TreeStats ComputeStats(const Bvh& bvh, const SahCost& cost, const CancelToken& cancel = {});

}  // namespace kdray::core
