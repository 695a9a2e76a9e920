// SPDX-License-Identifier: Apache-2.0
// The rounded arithmetic of the precision `exact`, with error bounds: in double for the signs of
// most triangles, in double-double for the others and for the numbers of an answer. The kernels do
// the same in vectors (core/kernel/simd/exact-inl.h, exact_hits-inl.h).
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/geometry/double_double.h"
#include "core/geometry/local_ray.h"
#include "core/geometry/vec3.h"

namespace kdray::core {

/// A number in double-double and a bound on its error.
struct BoundedNumber {
  DoubleDouble value;
  double error = std::numeric_limits<double>::infinity();
};

/// Whether the bound leaves only one nearest double. Source: Ziv 1991.
inline bool RoundsTo(const BoundedNumber& x, double* rounded) {
  *rounded = x.value.high + (x.value.low - x.error);
  return *rounded == x.value.high + (x.value.low + x.error);
}

/// Weights below it are rounded to multiples of 2^-52 times it, so those near 0 need no more digits
/// than others. Adding it to such a weight and subtracting it again rounds this way.
inline constexpr double kSmallWeight = 0x1p-8;
inline bool RoundsToWeight(const BoundedNumber& x, double* rounded) {
  const double added = x.value.high < kSmallWeight ? kSmallWeight : 0;
  const DoubleDouble sum = TwoSum(added, x.value.high);
  const bool is_known = RoundsTo({{sum.high, sum.low + x.value.low}, x.error + 0x1p-110}, rounded);
  *rounded -= added;
  return is_known;
}

struct RoundedRay {
  Vec3d direction;             ///< of LocalRay
  Vec3d origin;                ///< of LocalRay, which may have been moved along the ray
  Vec3d origin_low;            ///< the rounding error
  double origin_error = 0;     ///< on each axis, of origin + origin_low
  double origin_rounding = 0;  ///< on each axis, of origin
  double shift = 0, shift_low = 0;

  /// A triangle corner relative to the origin, rounded.
  struct Relative {
    Vec3d at;
    double size;  ///< largest |component|
  };
  struct Volume {
    double value;
    double error;  ///< bound
  };

  /// The error of an edge's volume in double is at most kProducts * (the sum of the sizes of its
  /// products) + kOrigin * origin_rounding * (the sum of the two corners' sizes) + kUnderflow.
  /// Shewchuk's bound for a determinant whose rows are rounded differences:
  static constexpr double kProducts = (7 + 56 * 0x1p-53) * 0x1p-53;
  /// The contribution of the origin's rounding: six products of a direction below 2, one corner and
  /// the other's error.
  static constexpr double kOrigin = 16;
  /// The contribution of underflow, of the products or of a direction's small components.
  static constexpr double kUnderflow = 0x1p-1000;

  /// Double-double: a dozen operations of relative error 2^-102 on terms of the summed sizes; and
  /// the smallest denominator for which kUnderflow is negligible.
  static constexpr double kStep = 0x1p-97;
  static constexpr double kLeastDenominator = 0x1p-900;

  RoundedRay() = default;
  /// For rays of MakeExactLocalRay.
  explicit RoundedRay(const LocalRay& ray)
      : direction(ray.direction),
        origin(ray.origin),
        origin_low(ray.origin_low),
        origin_error(ray.origin_error),
        origin_rounding(MaxAbs(ray.origin_low) + ray.origin_error),
        shift(ray.shift),
        shift_low(ray.shift_low) {}

  Relative RelativeTo(const Vec3d& corner) const {
    const Vec3d at = corner - origin;
    return {at, MaxAbs(at)};
  }
  /// The volume direction . ((p - origin) x (q - origin)), whose sign is the side on which the ray
  /// passes the edge p q.
  Volume EdgeVolume(const Relative& p, const Relative& q) const {
    const Vec3d& d = direction;
    const double yz = p.at.y * q.at.z, zy = p.at.z * q.at.y;
    const double zx = p.at.z * q.at.x, xz = p.at.x * q.at.z;
    const double xy = p.at.x * q.at.y, yx = p.at.y * q.at.x;
    const double value = d.x * (yz - zy) + d.y * (zx - xz) + d.z * (xy - yx);
    const double permanent = std::fabs(d.x) * (std::fabs(yz) + std::fabs(zy)) +
                             std::fabs(d.y) * (std::fabs(zx) + std::fabs(xz)) +
                             std::fabs(d.z) * (std::fabs(xy) + std::fabs(yx));
    return {value,
            kProducts * permanent + kOrigin * origin_rounding * (p.size + q.size) + kUnderflow};
  }

  /// The same in double-double.
  BoundedNumber EdgeVolume(const Vec3d& p, const Vec3d& q) const;
  /// A triangle's local parameter and the weights of its second and third corner; errors are
  /// infinite if that needs more digits.
  struct Solution {
    BoundedNumber s, u, v;
  };
  Solution Solve(const Vec3d& a, const Vec3d& b, const Vec3d& c) const;
  /// The local parameter from the origin as given.
  BoundedNumber Along(const BoundedNumber& s) const {
    return {DoubleDouble{shift, shift_low} + s.value, s.error + 0x1p-100 * std::fabs(shift)};
  }
  /// The contribution of the origin's error to sizes that are multiplied by kStep.
  double OriginSize() const { return origin_error / kStep; }

  /// Bounds of an end of the caller's interval as a local parameter, with a margin for its rounding
  /// and that of the caller's t.
  struct Bound {
    double low, high;
  };
  static Bound BoundOf(double t, const LocalRay& ray);
};

inline RoundedRay::Bound RoundedRay::BoundOf(double t, const LocalRay& ray) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  // The largest finite number is also the t of all larger parameters, so the answer itself decides.
  if (std::fabs(t) == std::numeric_limits<double>::max()) return {-kInfinity, kInfinity};
  if (std::isinf(t)) return {t, t};
  const double local = ScaleByPowerOfTwo(t, -ray.exponent);
  if (std::isinf(local)) return {-kInfinity, kInfinity};  // no bound beside a large shift
  // A t is rounded to a multiple of 2^-1074, which may be large in local lengths.
  const double room = 0x1p-48 * (std::fabs(local) + std::fabs(ray.shift)) + 0x1p-1000 +
                      ScaleByPowerOfTwo(0x1p-1074, -ray.exponent);
  return {(local - ray.shift) - 2 * room, (local - ray.shift) + 2 * room};
}

}  // namespace kdray::core
