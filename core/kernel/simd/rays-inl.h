// SPDX-License-Identifier: Apache-2.0
// A ray's constants for culling and for the filters, in float.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "core/geometry/local_ray.h"
#include "core/geometry/ray.h"
#include "core/geometry/vec3.h"
#include "core/kernel/simd/isa.h"
#include "core/kernel/simd/vectors-inl.h"

KDRAY_BEGIN_ISA();
namespace kdray::core::KDRAY_ISA {

/// The data of a single ray's traversal, except its stack.
struct CullRay {
  // Three components each; the fourth completes the vector.
  float inverse[4];         // of the direction; no zero, no infinity
  float origin_inverse[4];  // origin * inverse
  float enter;  // the search interval, local parameters, rounded outward; `exit` shrinks
  float exit;
  // Byte offsets in a node of the planes that the ray meets first, and last.
  std::uint32_t near_plane[4];
  std::uint32_t far_plane[4];
  std::uint32_t octant;

  float origin[4], direction[4];  // as FastIntersection has them
  std::uint32_t axis[3];          // as WatertightIntersection has them: x, y, z
  float shear[2];
  double shear_double[2], inverse_z;
};

KDRAY_INLINE float RoundedUp(double x) {
  const float f = static_cast<float>(x);
  return static_cast<double>(f) >= x ? f : f + __builtin_fabsf(f) * 0x1p-23f + 0x1p-149f;
}
KDRAY_INLINE float RoundedDown(double x) { return -RoundedUp(-x); }

/// The exponent of a positive normal number and 2^-exponent, by its bits.
struct PowerBelow {
  int exponent;
  double inverse;
};
KDRAY_INLINE PowerBelow PowerBelowOf(double x) {
  const std::uint64_t bits = std::bit_cast<std::uint64_t>(x) & 0x7ff0000000000000u;
  return {static_cast<int>(bits >> 52) - 1023, std::bit_cast<double>(0x7fe0000000000000u - bits)};
}

/// A local interval's ends as floats, moved outward by more than their rounding and that of the
/// parameters themselves.
KDRAY_INLINE float OutwardLow(double x) {
  const float f = static_cast<float>(x);
  return f - (__builtin_fabsf(f) * 0x1p-22f + 0x1p-40f);
}
KDRAY_INLINE float OutwardHigh(double x) {
  const float f = static_cast<float>(x);
  return f + (__builtin_fabsf(f) * 0x1p-22f + 0x1p-40f);
}

/// Computes the constants of box tests from the local origin and direction.
KDRAY_INLINE void PrepareBoxes(F4 origin, F4 direction, CullRay* ray) {
  // Such a small component does not move the ray within the mesh; a finite reciprocal avoids NaN in
  // box tests.
  const F4 sign = F4(U4(direction) & U4{0x80000000u, 0x80000000u, 0x80000000u, 0x80000000u});
  const F4 size = F4(U4(direction) & U4{0x7fffffffu, 0x7fffffffu, 0x7fffffffu, 0x7fffffffu});
  const F4 tiny = {0x1p-60f, 0x1p-60f, 0x1p-60f, 0x1p-60f};
  const F4 divisor = F4(U4(size < tiny ? tiny : size) | U4(sign));
  const F4 inverse = F4{1, 1, 1, 1} / divisor;
  StoreF4(inverse, ray->inverse);
  StoreF4(origin * inverse, ray->origin_inverse);
  StoreF4(origin, ray->origin);
  StoreF4(direction, ray->direction);
  std::uint32_t negative[4];
  const U4 signs = U4(divisor) >> U4{31, 31, 31, 31};
  __builtin_memcpy(negative, &signs, sizeof(negative));
  ray->octant = negative[0] | negative[1] << 1 | negative[2] << 2;
  constexpr std::uint32_t kRow = sizeof(F8);
  const U4 low = {0, kRow, 2 * kRow, 0};
  const U4 shift = signs * U4{3 * kRow, 3 * kRow, 3 * kRow, 0};
  const U4 near = low + shift;
  const U4 far = low + U4{3 * kRow, 3 * kRow, 3 * kRow, 0} - shift;
  __builtin_memcpy(ray->near_plane, &near, sizeof(near));
  __builtin_memcpy(ray->far_plane, &far, sizeof(far));
}

inline void Prepare(const LocalRay& local, CullRay* ray) {
  const LocalInterval interval = SearchInterval(local);
  ray->enter = OutwardLow(interval.enter);
  ray->exit = OutwardHigh(interval.exit);
  const auto narrow = [](const Vec3d& v) {
    return F4{static_cast<float>(v.x), static_cast<float>(v.y), static_cast<float>(v.z), 0};
  };
  PrepareBoxes(narrow(local.origin), narrow(local.direction), ray);
}

/// The mesh's frame in vectors.
struct FrameVectors {
  D4 origin;
  double scale;  // 2^-exponent; 0 if it is too extreme for PrepareUsual
  int exponent;

  explicit FrameVectors(const MeshFrame& frame)
      : origin{frame.origin.x, frame.origin.y, frame.origin.z, 0},
        scale(std::abs(frame.exponent) <= 400 ? PowerOfTwo(-frame.exponent) : 0),
        exponent(frame.exponent) {}
};

/// A ray as given: x, y, z and one end of the interval in each.
struct GivenRay {
  D4 from, to;
};
KDRAY_INLINE GivenRay LoadRay(const RayBatch& rays, std::size_t row) {
  if (const RayF* floats = rays.floats()) {
    return {Widen4(&floats[row].origin.x), Widen4(&floats[row].direction.x)};
  }
  return {Load4(&rays.doubles()[row].origin.x), Load4(&rays.doubles()[row].direction.x)};
}

/// The results of MakeLocalRay and Prepare, bit for bit except for the interval's float ends, for
/// usual rays: valid ones that begin near the mesh, without extreme numbers. LocalRay::inverse,
/// which only traversals in double use, is not set. False for other rays, which use the scalar
/// functions.
KDRAY_INLINE bool PrepareUsual(const RayBatch& rays, std::size_t row, const FrameVectors& frame,
                               LocalRay* local, CullRay* cull) {
  if (frame.scale == 0) return false;
  const auto [from, to] = LoadRay(rays, row);
  const D4 origin = (from - frame.origin) * Set4(frame.scale);
  const D4 size = Abs(to);
  const double largest = std::max({size[0], size[1], size[2]});
  const D4 zero = Set4(0);
  // NaN fails every comparison, and a component that is not finite gives NaN here.
  const D4 no_nan = to - to;  // NOLINT(misc-redundant-expression)
  const unsigned finite = Bits(L4(no_nan == zero)) & Bits(L4(Abs(origin) <= Set4(4)));
  if ((finite & 7u) != 7u || !(from[3] <= to[3])) return false;
  if (!(largest > 0x1p-400 && largest < 0x1p400)) return false;
  const PowerBelow power = PowerBelowOf(largest);
  const D4 direction = to * Set4(power.inverse);
  local->origin = {origin[0], origin[1], origin[2]};
  local->direction = {direction[0], direction[1], direction[2]};
  local->exponent = frame.exponent - power.exponent;
  local->shift = 0;
  local->t_min = from[3];
  local->t_max = to[3];
  const double to_local = PowerOfTwo(-local->exponent);
  cull->enter = OutwardLow(from[3] * to_local);
  cull->exit = OutwardHigh(to[3] * to_local);
  PrepareBoxes(Narrow(origin), Narrow(direction), cull);
  return true;
}

/// Computes the constants of the filters of projected triangles; the quotients are those of
/// WatertightIntersection. No branch depends on the axis, which is random for unrelated rays.
inline void PrepareShear(const LocalRay& local, CullRay* ray) {
  const double d[3] = {local.direction.x, local.direction.y, local.direction.z};
  const double x = std::fabs(d[0]), y = std::fabs(d[1]), z = std::fabs(d[2]);
  const auto y_beats_x = static_cast<std::uint32_t>(y > x);
  const auto z_beats_both = static_cast<std::uint32_t>(z > std::max(x, y));
  constexpr std::uint32_t kNext[3] = {1, 2, 0};
  ray->axis[2] = z_beats_both << 1 | (y_beats_x & ~z_beats_both);
  ray->axis[0] = kNext[ray->axis[2]];
  ray->axis[1] = kNext[ray->axis[0]];
  const D4 quotients = D4{d[ray->axis[0]], d[ray->axis[1]], 1, 0} / Set4(d[ray->axis[2]]);
  for (int k = 0; k < 2; ++k) {
    ray->shear_double[k] = quotients[k];
    ray->shear[k] = static_cast<float>(quotients[k]);
  }
  ray->inverse_z = quotients[2];
}

}  // namespace kdray::core::KDRAY_ISA
KDRAY_END_ISA();
