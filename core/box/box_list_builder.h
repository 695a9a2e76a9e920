// Builds a BoxList, and says what it costs.
#pragma once

#include "core/base/result.h"
#include "core/box/box_list.h"
#include "core/geometry/triangle_mesh.h"
#include "core/tree/build_options.h"
#include "core/tree/sah_cost.h"
#include "core/tree/tree_stats.h"

namespace kdray::core {

/// The bounds and ids of all triangles that are not degenerate. O(n). Errors: kCancelled,
/// kDeadlineExceeded.
Result<BoxList> BuildBoxList(const TriangleMesh& mesh, const BuildOptions& options);

/// One leaf, whose cost is that of all its triangles.
TreeStats ComputeStats(const BoxList& box, const SahCost& cost, const CancelToken& cancel = {});

}  // namespace kdray::core
