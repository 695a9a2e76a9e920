// SPDX-License-Identifier: Apache-2.0
// Axis-aligned boxes (AABB).
#pragma once

#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>

#include "core/geometry/vec3.h"

namespace kdray::core {

/// The closed box [min, max]. Empty() is inverted, so Extend() needs no special first case.
template <class T>
struct Bounds3 {
  Vec3<T> min, max;

  static Bounds3 Empty() {
    constexpr T kInf = std::numeric_limits<T>::infinity();
    return {{kInf, kInf, kInf}, {-kInf, -kInf, -kInf}};
  }
  bool IsEmpty() const { return !(min.x <= max.x && min.y <= max.y && min.z <= max.z); }

  void Extend(const Vec3<T>& point) {
    min = Min(min, point);
    max = Max(max, point);
  }
  void Extend(const Bounds3& other) {
    min = Min(min, other.min);
    max = Max(max, other.max);
  }
  Vec3<T> Extent() const { return max - min; }
  Vec3<T> Center() const { return min * T(0.5) + max * T(0.5); }
  /// Corner 0..7: bits 0, 1, 2 of `i` choose max instead of min along x, y, z.
  Vec3<T> Corner(unsigned i) const {
    return {(i & 1) != 0 ? max.x : min.x, (i & 2) != 0 ? max.y : min.y,
            (i & 4) != 0 ? max.z : min.z};
  }

  /// Area of the six faces; 0 for an empty box.
  T SurfaceArea() const {
    if (IsEmpty()) return T(0);
    const Vec3<T> e = Extent();
    return T(2) * (e.x * e.y + e.y * e.z + e.z * e.x);
  }
  bool Contains(const Vec3<T>& p) const {
    return min.x <= p.x && p.x <= max.x && min.y <= p.y && p.y <= max.y && min.z <= p.z &&
           p.z <= max.z;
  }
  friend bool operator==(const Bounds3&, const Bounds3&) = default;
};

using Bounds3f = Bounds3<float>;
using Bounds3d = Bounds3<double>;

/// The intersection of two boxes; empty (inverted) when they are disjoint.
template <class T>
Bounds3<T> Intersection(const Bounds3<T>& a, const Bounds3<T>& b) {
  return {Max(a.min, b.min), Min(a.max, b.max)};
}

/// std::nextafter(x, infinity) for x < infinity, without a library call.
inline float NextAbove(float x) {
  const float positive_zero = x + 0.0f;
  const std::int32_t bits = std::bit_cast<std::int32_t>(positive_zero);
  return std::bit_cast<float>(bits + (bits < 0 ? -1 : 1));
}

/// Largest float <= value, and smallest float >= value: boxes are rounded outward, never inward.
inline float RoundUp(double value) {
  const float rounded = static_cast<float>(value);
  return static_cast<double>(rounded) >= value ? rounded : NextAbove(rounded);
}
inline float RoundDown(double value) { return -RoundUp(-value); }
inline Bounds3f RoundOutward(const Bounds3d& b) {
  return {{RoundDown(b.min.x), RoundDown(b.min.y), RoundDown(b.min.z)},
          {RoundUp(b.max.x), RoundUp(b.max.y), RoundUp(b.max.z)}};
}

}  // namespace kdray::core
