// SPDX-License-Identifier: Apache-2.0
// The point of a mesh that a hit names.
#pragma once

#include <cassert>

#include "core/geometry/hit.h"
#include "core/geometry/triangle_mesh.h"
#include "core/geometry/vec3.h"

namespace kdray::core {

/// The point of the hit triangle with the hit's weights u and v, computed in double, world units.
/// It is not origin + t * direction, whose error grows with t. Finite, never -0. `hit` must not be
/// a miss (Hit::IsHit).
inline Vec3d SurfacePoint(const TriangleMesh& mesh, const Hit& hit) {
  assert(hit.IsHit());
  const Vec3d a = mesh.LocalCorner(hit.primitive_id, 0);
  const Vec3d b = mesh.LocalCorner(hit.primitive_id, 1);
  const Vec3d c = mesh.LocalCorner(hit.primitive_id, 2);
  const Vec3d local = a * (1 - hit.u - hit.v) + b * hit.u + c * hit.v;
  return mesh.frame().ToWorld(local) + Vec3d{};  // -0 + 0 is 0
}

}  // namespace kdray::core
