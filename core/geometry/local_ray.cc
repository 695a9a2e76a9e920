#include "core/geometry/local_ray.h"

namespace kdray::core {

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

  if (!(MaxAbs(local.origin) <= 4)) {
    constexpr double kInf = std::numeric_limits<double>::infinity();
    // Far away the direction's own rounding matters more than any pad: the box is twice the mesh's.
    const Bounds3d box{{-2, -2, -2}, {2, 2, 2}};
    const LocalInterval inside = ClipToBox(local, box, 0, {-kInf, kInf});
    if (inside.IsEmpty() || !std::isfinite(inside.enter)) return std::nullopt;
    local.shift = inside.enter;
    local.origin = local.origin + inside.enter * local.direction;
    if (!(MaxAbs(local.origin) <= 4))
      return std::nullopt;  // so far out that the entry is lost in rounding
  }
  return local;
}

}  // namespace kdray::core
