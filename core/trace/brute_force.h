// SPDX-License-Identifier: Apache-2.0
// Reference answers: every triangle with every ray by the same triangle intersection, without
// structure and culling. The oracle of tests; too slow for anything else.
#pragma once

#include <vector>

#include "core/geometry/hit.h"
#include "core/geometry/ray.h"
#include "core/geometry/triangle_mesh.h"
#include "core/intersect/hit_filter.h"
#include "core/intersect/precision.h"

namespace kdray::core {

// O(triangles) each. `filter` is that of TraceOptions, but t_max is the caller's: a segment that
// ends on a surface has t_max = 1.

/// The answer that TraceClosest must give for any tree over this mesh.
Hit BruteForceClosest(const TriangleMesh& mesh, const Ray& ray, Precision precision,
                      const HitFilter::Options& filter = {});
bool BruteForceAny(const TriangleMesh& mesh, const Ray& ray, Precision precision,
                   const HitFilter::Options& filter = {});

/// The answer that TraceAll must give without limits.
std::vector<Hit> BruteForceAll(const TriangleMesh& mesh, const Ray& ray, Precision precision,
                               const HitFilter::Options& filter = {});

}  // namespace kdray::core
