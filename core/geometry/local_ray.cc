#include "core/geometry/local_ray.h"

namespace kdray::core {
namespace {

void MoveBy(double s, LocalRay* ray) {
  ray->shift = s;
  ray->origin = ray->origin + s * ray->direction;
}

/// Moves the origin along the ray to near the mesh; false when the ray misses that.
bool MoveToMesh(LocalRay* ray) {
  // The box is twice the mesh's: where rounding on the way here is below 1, no ray that meets the
  // mesh is lost.
  constexpr double kFar = 0x1p46;
  const double distance = MaxAbs(ray->origin);
  if (distance <= kFar) {
    constexpr double kInf = std::numeric_limits<double>::infinity();
    const LocalInterval inside =
        ClipToBox(*ray, Bounds3d{{-2, -2, -2}, {2, 2, 2}}, 0, {-kInf, kInf});
    if (inside.IsEmpty() || !std::isfinite(inside.enter)) return false;
    MoveBy(inside.enter, ray);
    return MaxAbs(ray->origin) <= 4;
  }
  // Farther out the ray may pass the mesh anywhere as far as double can tell, and only `exact`,
  // which goes back to the ray as given, knows. Its pad grows with the shift and covers what is
  // lost here: the point nearest to the middle of the frame is off by up to 2^-51 of the distance,
  // and moved by no more than that again.
  MoveBy(-Dot(ray->origin, ray->direction) / Dot(ray->direction, ray->direction), ray);
  if (!(MaxAbs(ray->origin) <= 2 + 0x1p-51 * distance)) return false;
  for (int axis = 0; axis < 3; ++axis) ray->origin[axis] = std::clamp(ray->origin[axis], -4.0, 4.0);
  return true;
}

}  // namespace

std::optional<LocalRay> MakeLocalRay(const Ray& ray, const MeshFrame& frame) {
  LocalRay local;
  local.t_min = ray.t_min;
  local.t_max = ray.t_max;
  local.given = &ray;
  local.frame = &frame;
  local.origin = frame.ToLocal(ray.origin);

  // world(t) = origin + t * direction, local = (world - frame.origin) * 2^-e, so one unit of t is
  // direction * 2^-e in the mesh's frame. The local direction is the caller's times 2^-k; hence s =
  // t * 2^(k - e).
  const int k = std::ilogb(MaxAbs(ray.direction));
  for (int axis = 0; axis < 3; ++axis) {
    local.direction[axis] = ScaleByPowerOfTwo(ray.direction[axis], -k);
  }
  local.exponent = frame.exponent - k;

  for (int axis = 0; axis < 3; ++axis) {
    const double d = local.direction[axis];
    local.inverse[axis] = std::fabs(d) < LocalRay::kTinyDirection ? 0.0 : 1.0 / d;
  }

  if (!(MaxAbs(local.origin) <= 4) && !MoveToMesh(&local)) return std::nullopt;
  return local;
}

}  // namespace kdray::core
