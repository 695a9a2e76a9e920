// SPDX-License-Identifier: Apache-2.0
// A ray in the frame of one mesh, ready for traversal; and the rule that keeps culling and leaf
// tests in step.
//
// The fat ray. Every leaf test accepts a triangle only if the ray passes it within `pad` of a point
// Q of the triangle and reports Q's parameter t along the ray. Every cull (split plane, box) keeps
// whatever lies within `pad` of the ray. So no structure can lose a triangle that the leaf test
// would accept, and the closest hit, the minimum of (t, id) over all accepted triangles, is the
// same for every structure, kernel and SIMD width. DESIGN.md, decision 5, has the proof and the
// size of `pad` for each precision.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>

#include "core/geometry/bounds3.h"
#include "core/geometry/power_of_two.h"
#include "core/geometry/ray.h"
#include "core/geometry/triangle_mesh.h"

namespace kdray::core {

/// Distances by which leaf tests may be off, in local units (the mesh lies in [-1, 1]^3), with room
/// for the rounding of a cull in double. Float tests: 64 ulp of 1, doubled. Double tests: the same
/// in double, 2^4 wider.
inline constexpr double kFloatPad = 0x1p-17;
inline constexpr double kDoublePad = 0x1p-45;

/// The caller's t of a parameter that counts lengths of the local direction, from the origin as
/// given: rounded, never -0, and the largest finite number where t is beyond it. Monotonic.
inline double ToCallerT(double along, int exponent) {
  constexpr double kMost = std::numeric_limits<double>::max();
  return std::clamp(ScaleByPowerOfTwo(along, exponent), -kMost, kMost) + 0.0;
}

/// The ray as the tests see it. Its parameter s relates to the caller's t by t = (s + shift) *
/// 2^exponent: directions are scaled by an exact power of two so that the largest |component| lies
/// in [1, 2), and an origin outside [-4, 4]^3 is moved along the ray: to where it enters [-2, 2]^3,
/// so that float tests keep their accuracy for far cameras, and from beyond 2^46 mesh sizes to
/// where it is nearest to the middle of the frame, without rounding on the way. (A shift beyond
/// 2^1000 is scaled down and `exponent` up instead: s then counts for nothing beside it.)
struct LocalRay {
  Vec3d origin;     ///< |component| <= 4
  Vec3d direction;  ///< largest |component| in [1, 2)
  Vec3d inverse;    ///< 1 / direction; 0 where |component| < kTinyDirection, which
                    ///< a cull treats as parallel
  double shift = 0;
  int exponent = 0;
  double t_min = 0;  ///< the caller's interval, in the caller's t
  double t_max = 0;

  // Set by MakeExactLocalRay: the rounding errors of `origin`, each to within origin_error, and of
  // `shift`.
  Vec3d origin_low;
  double origin_error = 0;
  double shift_low = 0;

  /// The ray as given, for tests that use the caller's numbers. Must outlive this.
  const Ray* given = nullptr;
  const MeshFrame* frame = nullptr;

  /// Below this a component moves the ray by less than kDoublePad within the mesh.
  static constexpr double kTinyDirection = 0x1p-60;

  /// The caller's t of a local parameter. Monotonic.
  double ToCallerT(double s) const { return core::ToCallerT(s + shift, exponent); }
  /// The local parameter of a caller's t, rounded: for culling only, after padding.
  double ToLocalT(double t) const { return ScaleByPowerOfTwo(t, -exponent) - shift; }
};

/// The part of a ray's parameter range that is still to be searched, local parameters. Not
/// initialised, so that a traversal's stack costs nothing until it is used.
struct LocalInterval {
  double enter;
  double exit;
  bool IsEmpty() const { return !(enter <= exit); }
};

/// The local form of a valid ray (IsValid); keeps pointers to both arguments. nullopt when the ray
/// misses [-2, 2]^3 and so the mesh.
std::optional<LocalRay> MakeLocalRay(const Ray& ray, const MeshFrame& frame);
/// The same, with the origin moved without rounding from any distance: `origin` is within 2^-50 of
/// a point of the ray as given; origin_low, shift and shift_low hold the rest.
std::optional<LocalRay> MakeExactLocalRay(const Ray& ray, const MeshFrame& frame);

/// Where the fat ray (half-width `pad`) is inside `box`; empty when it passes by. Right for zero
/// direction components, flat boxes and infinite intervals. Source: Kay and Kajiya 1986 (slabs);
/// Ize 2013 (conservative bounds).
inline LocalInterval ClipToBox(const LocalRay& ray, const Bounds3d& box, double pad,
                               LocalInterval interval) {
  for (int axis = 0; axis < 3; ++axis) {
    const double origin = ray.origin[axis];
    const double low = box.min[axis] - pad;
    const double high = box.max[axis] + pad;
    const double inverse = ray.inverse[axis];
    if (inverse == 0) {
      if (origin < low || origin > high) return {0, -1};
      continue;
    }
    const double to_low = (low - origin) * inverse;
    const double to_high = (high - origin) * inverse;
    // No NaN can arise (finite times non-zero), so the plain minimum does, which is one instruction
    // unlike std::fmin.
    interval.enter = std::max(interval.enter, std::min(to_low, to_high));
    interval.exit = std::min(interval.exit, std::max(to_low, to_high));
  }
  return interval;
}

/// The caller's [t_min, t_max] as local parameters, rounded outward.
inline LocalInterval SearchInterval(const LocalRay& ray) {
  constexpr double kSlack = 0x1p-48;
  // The largest finite numbers bound nothing that lies beyond them: they are its t.
  using Limits = std::numeric_limits<double>;
  const double t_min = ray.t_min == Limits::lowest() ? -Limits::infinity() : ray.t_min;
  const double t_max = ray.t_max == Limits::max() ? Limits::infinity() : ray.t_max;
  const double enter = ray.ToLocalT(t_min);
  const double exit = ray.ToLocalT(t_max);
  // The rounding of a conversion is relative to |t| and |shift|, not to their difference. An end
  // that overflows says nothing beside a shift that is almost as large.
  // And t is rounded to multiples of 2^-1074, which may be more than the mesh in local lengths.
  const double scale =
      std::fabs(ray.shift) + 8 + ScaleByPowerOfTwo(0x1p-1074, -ray.exponent) / kSlack;
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  const bool is_extreme = std::fabs(ray.shift) > 0x1p800;
  return {
      is_extreme && std::isinf(enter) ? -kInfinity : enter - kSlack * (std::fabs(enter) + scale),
      is_extreme && std::isinf(exit) ? kInfinity : exit + kSlack * (std::fabs(exit) + scale)};
}

}  // namespace kdray::core
