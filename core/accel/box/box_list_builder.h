// SPDX-License-Identifier: Apache-2.0
// Builds a BoxList, and computes its statistics.
#pragma once

#include "core/accel/box/box_list.h"
#include "core/accel/build_options.h"
#include "core/accel/sah_cost.h"
#include "core/accel/tree_stats.h"
#include "core/base/result.h"
#include "core/geometry/triangle_mesh.h"

namespace kdray::core {

/// The bounds and ids of all triangles that are not degenerate. O(n). Errors: kCancelled,
/// kDeadlineExceeded.
Result<BoxList> BuildBoxList(const TriangleMesh& mesh, const BuildOptions& options);

/// One leaf, whose cost is that of all its triangles.
TreeStats ComputeStats(const BoxList& box, const SahCost& cost, const CancelToken& cancel = {});

}  // namespace kdray::core
