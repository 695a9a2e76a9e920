// SPDX-License-Identifier: Apache-2.0
// The origin of a secondary ray that does not hit the surface that it leaves.
#pragma once

#include "core/geometry/hit.h"
#include "core/geometry/triangle_mesh.h"
#include "core/geometry/vec3.h"
#include "core/intersect/precision.h"

namespace kdray::core {

/// The origin, in world units, of a ray that leaves `hit` towards `direction` (any length) and is
/// traced in that precision: the point with the hit's u and v, moved off the triangle to the side
/// that the direction points to, far enough for the rounding of that point and of the precision's
/// triangle intersection. A surface closer than that to the hit may be missed: at most 2^-22 of the
/// mesh's size (4 ulp of a float) in `fast` and `watertight`, 2^-46 in `double` and 2^-47 in
/// `exact`, or some ulps of the world coordinates where these are larger. `hit` must not be a miss
/// (Hit::IsHit). Source: Pharr, Jakob, Humphreys, "Physically Based Rendering", 4th ed., 6.8.
Vec3d LeaveSurface(const TriangleMesh& mesh, const Hit& hit, const Vec3d& direction,
                   Precision precision);

}  // namespace kdray::core
