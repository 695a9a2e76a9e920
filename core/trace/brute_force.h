// Reference answers: every triangle with every ray by the same triangle intersection, without
// structure and culling. The oracle of tests; too slow for anything else.
#pragma once

#include "core/geometry/hit.h"
#include "core/geometry/ray.h"
#include "core/geometry/triangle_mesh.h"
#include "core/intersect/precision.h"

namespace kdray::core {

/// The answer that ClosestHit must give for any tree over this mesh. O(triangles).
Hit BruteForceClosest(const TriangleMesh& mesh, const Ray& ray, Precision precision);
bool BruteForceAny(const TriangleMesh& mesh, const Ray& ray, Precision precision);

}  // namespace kdray::core
