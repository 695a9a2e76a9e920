#include "core/trace/leave_surface.h"

#include <cassert>
#include <cmath>
#include <limits>

namespace kdray::core {
namespace {

/// Bound of the error, per axis and in local units, of the origin of a ray that starts beside a
/// triangle: some roundings of coordinates below 2 in the test's arithmetic. Half of it was enough
/// for every ray of N16 (tests/property/secondary_rays_test.cc), a quarter was not.
double LeafTestError(Precision precision) {
  switch (precision) {
    case Precision::kFast:
    case Precision::kWatertight:
      return 0x1p-23;
    case Precision::kDouble:
      return 0x1p-47;
    case Precision::kExact:
      return 0;  // uses the origin as given
  }
  return 0;
}

}  // namespace

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
                         0x1p-51 * (world + 2) + LeafTestError(precision);
    distance += std::fabs(normal[axis]) * error;
  }
  return frame.ToWorld(point + normal * distance);
}

}  // namespace kdray::core
