// Reference answers: every triangle against every ray with the same leaf test, no structure and no
// culling. The oracle of tests and of the measured trade; far too slow for
// anything else.
#pragma once

#include "core/geometry/hit.h"
#include "core/geometry/ray.h"
#include "core/geometry/triangle_mesh.h"
#include "core/intersect/precision.h"

namespace kdray::core {

/// What ClosestHit must answer for any tree over this mesh. O(triangles).
Hit BruteForceClosest(const TriangleMesh& mesh, const Ray& ray, Precision precision);
bool BruteForceAny(const TriangleMesh& mesh, const Ray& ray, Precision precision);

}  // namespace kdray::core
