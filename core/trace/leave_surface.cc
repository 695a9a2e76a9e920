// SPDX-License-Identifier: Apache-2.0
#include "core/trace/leave_surface.h"

#include <cassert>
#include <cmath>

namespace kdray::core {

Vec3d LeaveSurface(const TriangleMesh& mesh, const Hit& hit, const Vec3d& direction,
                   Precision precision) {
  assert(hit.IsHit());
  const MeshFrame& frame = mesh.frame();
  const Vec3d a = mesh.LocalCorner(hit.primitive_id, 0);
  const Vec3d b = mesh.LocalCorner(hit.primitive_id, 1);
  const Vec3d c = mesh.LocalCorner(hit.primitive_id, 2);
  const Vec3d point = a * (1 - hit.u - hit.v) + b * hit.u + c * hit.v;
  Vec3d normal = Cross(b - a, c - a);
  if (normal == Vec3d{}) return frame.ToWorld(point);  // a line in double: it has no side
  normal = NormalizedAtAnyScale(normal);
  if (Dot(normal, direction) < 0) normal = -normal;

  // Errors of the point, a sum of three products with weights of few roundings, of its conversion
  // to world units, and of the trace's conversion back.
  double distance = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const double world = std::fabs(ScaleByPowerOfTwo(frame.origin[axis], -frame.exponent));
    const double error = 0x1p-50 * (std::fabs(a[axis]) + std::fabs(b[axis]) + std::fabs(c[axis])) +
                         0x1p-51 * (world + 2) + TraitsOf(precision).origin_error;
    distance += std::fabs(normal[axis]) * error;
  }
  return frame.ToWorld(point + normal * distance);
}

}  // namespace kdray::core
