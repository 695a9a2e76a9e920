// SPDX-License-Identifier: Apache-2.0
#include "core/geometry/local_ray.h"

#include "core/geometry/double_double.h"
#include "core/geometry/dyadic.h"

namespace kdray::core {
namespace {

// From farther away, rounding on the way to the mesh may exceed 1, so double cannot tell whether
// the ray meets the mesh.
constexpr double kFar = 0x1p46;
// Bound of the error of two doubles for a coordinate up to 4, with a margin.
constexpr double kErrorOfTwo = 0x1p-100;

LocalRay Unmoved(const Ray& ray, const MeshFrame& frame) {
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
  return local;
}

/// Moves the origin to where the ray enters [-2, 2]^3; false when it misses that. The box is twice
/// the mesh's, and rounding on the way is below 1, so no ray that meets the mesh is lost.
bool MoveToBox(LocalRay* ray) {
  constexpr double kInf = std::numeric_limits<double>::infinity();
  const LocalInterval inside = ClipToBox(*ray, Bounds3d{{-2, -2, -2}, {2, 2, 2}}, 0, {-kInf, kInf});
  if (inside.IsEmpty() || !std::isfinite(inside.enter)) return false;
  ray->shift = inside.enter;
  ray->origin = ray->origin + inside.enter * ray->direction;
  return MaxAbs(ray->origin) <= 4;
}

/// The origin as given in the mesh's frame, one axis: rounded to double, and the rest.
DoubleDouble OriginAsGiven(const LocalRay& ray, int axis) {
  const DoubleDouble moved = TwoDifference(ray.given->origin[axis], ray.frame->origin[axis]);
  return {ScaleByPowerOfTwo(moved.high, -ray.frame->exponent),
          ScaleByPowerOfTwo(moved.low, -ray.frame->exponent)};
}

/// Recomputes the origin that MoveToBox found, from the ray as given: a sum of four terms, of which
/// the largest two cancel.
void RefineOrigin(LocalRay* ray) {
  for (int axis = 0; axis < 3; ++axis) {
    const DoubleDouble start = OriginAsGiven(*ray, axis);
    const DoubleDouble way = TwoProduct(ray->shift, ray->direction[axis]);
    const DoubleDouble high = TwoSum(start.high, way.high);
    const DoubleDouble low = TwoSum(start.low, way.low);
    const DoubleDouble sum = TwoSum(high.high, low.high);
    const DoubleDouble rest = TwoSum(sum.low, high.low);
    const DoubleDouble origin = TwoSum(sum.high, rest.high + (rest.low + low.low));
    ray->origin[axis] = origin.high;
    ray->origin_low[axis] = origin.low;
  }
  ray->origin_error = kErrorOfTwo;
}

/// Moves the origin to where the ray is nearest to the middle of the frame, to within 2^-8 lengths
/// of its direction; false when that is too far for the mesh, which is within sqrt(3) of the
/// middle.
bool MoveFromFar(LocalRay* ray) {
  const int frame_exponent = ray->frame->exponent;
  const int direction_exponent = std::ilogb(MaxAbs(ray->given->direction));
  Dyadic origin[3], direction[3], along, square;
  for (int axis = 0; axis < 3; ++axis) {
    origin[axis] = (Dyadic(ray->given->origin[axis]) - Dyadic(ray->frame->origin[axis]))
                       .TimesPowerOfTwo(-frame_exponent);
    direction[axis] = Dyadic(ray->given->direction[axis]).TimesPowerOfTwo(-direction_exponent);
    along = along - origin[axis] * direction[axis];
    square = square + direction[axis] * direction[axis];
  }
  Dyadic shift = Dyadic::Quotient(along, square, -8);
  for (int axis = 0; axis < 3; ++axis) {
    const Dyadic moved = origin[axis] + shift * direction[axis];
    const double rounded = moved.ToDouble();
    if (!(std::fabs(rounded) <= 2)) return false;
    ray->origin[axis] = rounded;
    ray->origin_low[axis] = (moved - Dyadic(rounded)).ToDouble();
  }
  ray->origin_error = kErrorOfTwo;
  // Not 0, because the origin as given is farther from the middle.
  constexpr int kLargest = 1000, kScaled = 900;
  if (shift.Exponent() > kLargest) {
    const int down = static_cast<int>(shift.Exponent()) - kScaled;
    shift = shift.TimesPowerOfTwo(-down);
    ray->exponent += down;
  }
  ray->shift = shift.ToDouble();
  ray->shift_low = (shift - Dyadic(ray->shift)).ToDouble();
  return true;
}

}  // namespace

std::optional<LocalRay> MakeLocalRay(const Ray& ray, const MeshFrame& frame) {
  LocalRay local = Unmoved(ray, frame);
  const double distance = MaxAbs(local.origin);
  if (distance <= 4) return local;
  if (distance <= kFar ? MoveToBox(&local) : MoveFromFar(&local)) return local;
  return std::nullopt;
}

std::optional<LocalRay> MakeExactLocalRay(const Ray& ray, const MeshFrame& frame) {
  LocalRay local = Unmoved(ray, frame);
  const double distance = MaxAbs(local.origin);
  if (distance <= 4) {
    for (int axis = 0; axis < 3; ++axis) local.origin_low[axis] = OriginAsGiven(local, axis).low;
    return local;
  }
  if (distance > kFar) return MoveFromFar(&local) ? std::optional(local) : std::nullopt;
  if (!MoveToBox(&local)) return std::nullopt;
  RefineOrigin(&local);
  return local;
}

}  // namespace kdray::core
