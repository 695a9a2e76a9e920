// SPDX-License-Identifier: Apache-2.0
// Prepares rays together, in lanes as rays-inl.h does for one.
#pragma once

#include <cstddef>
#include <cstdint>

#include "core/accel/wide/wide_tree.h"
#include "core/geometry/local_ray.h"
#include "core/geometry/ray.h"
#include "core/kernel/simd/isa.h"
#include "core/kernel/simd/rays-inl.h"
#include "core/kernel/simd/vectors-inl.h"
#include "core/kernel/simd/vectors16-inl.h"

KDRAY_BEGIN_ISA();
namespace kdray::core::KDRAY_ISA {

/// By place. Data of places outside `usual` is invalid.
struct PreparedRays {
  static constexpr std::size_t kRays = 64;

  // As CullRay has them.
  alignas(64) float origin[3][kRays], direction[3][kRays];
  alignas(64) float inverse[3][kRays], origin_inverse[3][kRays], enter[kRays], exit[kRays];
  // As LocalRay has them.
  alignas(32) double local_origin[3][kRays], local_direction[3][kRays];
  alignas(32) double t_min[kRays], t_max[kRays];
  alignas(32) std::int64_t exponent[kRays];
  std::uint64_t usual;  ///< the places that PrepareUsual takes

  /// The first `count` places; some after them are overwritten.
  void Prepare(const RayBatch& rays, const FrameVectors& frame, const std::size_t (&rows)[kRays],
               std::size_t count) {
    usual = 0;
    if (frame.scale == 0) return;
    for (std::size_t i = 0; i < count; i += 4) PrepareFour(rays, frame, rows + i, i);
    for (std::size_t i = 0; i < count; i += 8) PrepareBoxesOfEight(i);
  }

  /// A place's ray, and its CullRay.
  KDRAY_INLINE LocalRay Extract(std::size_t k, CullRay* cull) const {
    LocalRay local;
    for (int axis = 0; axis < 3; ++axis) {
      cull->origin[axis] = origin[axis][k];
      cull->direction[axis] = direction[axis][k];
      cull->inverse[axis] = inverse[axis][k];
      local.origin[axis] = local_origin[axis][k];
      local.direction[axis] = local_direction[axis][k];
    }
    cull->enter = enter[k];
    cull->exit = exit[k];
    local.exponent = static_cast<int>(exponent[k]);
    local.t_min = t_min[k];
    local.t_max = t_max[k];
    return local;
  }
  /// Inserts a ray that was prepared by itself.
  void Insert(std::size_t k, const CullRay& cull) {
    for (int axis = 0; axis < 3; ++axis) {
      origin[axis][k] = cull.origin[axis];
      direction[axis][k] = cull.direction[axis];
      inverse[axis][k] = cull.inverse[axis];
      origin_inverse[axis][k] = cull.origin_inverse[axis];
    }
    enter[k] = cull.enter;
    exit[k] = cull.exit;
  }
  /// The places whose rays meet the box of the whole tree.
  KDRAY_INLINE std::uint64_t MeetRoot(const WideTree& tree, std::size_t count) const {
    std::uint64_t met = 0;
    for (std::size_t at = 0; at < count; at += 16) {
      F16 first = Load16(enter + at), last = Load16(exit + at);
      for (int axis = 0; axis < 3; ++axis) {
        const F16 i = Load16(inverse[axis] + at), o = Load16(origin_inverse[axis] + at);
        const F16 a = MulSub(Set16(tree.bounds.min[axis]), i, o);
        const F16 b = MulSub(Set16(tree.bounds.max[axis]), i, o);
        first = Max(first, Min(a, b));
        last = Min(last, Max(a, b));
      }
      met |= std::uint64_t{Bits(LessEqual(first, last))} << at;
    }
    return met;
  }

 private:
  void PrepareFour(const RayBatch& rays, const FrameVectors& frame, const std::size_t* rows,
                   std::size_t at) {
    D4 from[4], to[4];  // of a ray, then of x, y, z and the interval's ends
    for (std::size_t k = 0; k < 4; ++k) {
      const GivenRay given = LoadRay(rays, rows[k]);
      from[k] = given.from;
      to[k] = given.to;
    }
    Transpose4(from);
    Transpose4(to);
    const D4 zero = Set4(0);
    const D4 largest = Max(Max(Abs(to[0]), Abs(to[1])), Abs(to[2]));
    // NaN fails every comparison, and a component that is not finite gives NaN here.
    L4 taken = (from[3] <= to[3]) & (largest > Set4(0x1p-400)) & (largest < Set4(0x1p400));
    // The largest component's exponent, and its powers of two, by their bits.
    const L4 power = L4(largest) & 0x7ff0000000000000;
    const D4 to_direction = D4(0x7fe0000000000000 - power);
    const D4 to_interval = D4(power - (static_cast<std::int64_t>(frame.exponent) << 52));
    for (int axis = 0; axis < 3; ++axis) {
      const D4 local = (from[axis] - Set4(frame.origin[axis])) * Set4(frame.scale);
      const D4 scaled = to[axis] * to_direction;
      const D4 no_nan = to[axis] - to[axis];  // NOLINT(misc-redundant-expression)
      taken &= (no_nan == zero) & (Abs(local) <= Set4(4));
      Store(local, local_origin[axis] + at);
      Store(scaled, local_direction[axis] + at);
      StoreF4(Narrow(local), origin[axis] + at);
      StoreF4(Narrow(scaled), direction[axis] + at);
    }
    const L4 exponents = (frame.exponent + 1023) - (power >> 52);
    __builtin_memcpy(exponent + at, &exponents, sizeof(exponents));
    Store(from[3], t_min + at);
    Store(to[3], t_max + at);
    // As OutwardLow and OutwardHigh.
    const F4 low = Narrow(from[3] * to_interval);
    const F4 high = Narrow(to[3] * to_interval);
    const F4 part = {0x1p-22f, 0x1p-22f, 0x1p-22f, 0x1p-22f};
    const F4 rest = {0x1p-40f, 0x1p-40f, 0x1p-40f, 0x1p-40f};
    StoreF4(low - (Abs(low) * part + rest), enter + at);
    StoreF4(high + (Abs(high) * part + rest), exit + at);
    usual |= std::uint64_t{Bits(taken)} << at;
  }

  // As PrepareBoxes.
  void PrepareBoxesOfEight(std::size_t at) {
    for (int axis = 0; axis < 3; ++axis) {
      const F8 along = Load(direction[axis] + at);
      const I8 sign = I8(along) & SetI8(0x80000000u);
      const F8 reciprocal = Set8(1) / F8(I8(Max(Abs(along), Set8(0x1p-60f))) | sign);
      Store(reciprocal, inverse[axis] + at);
      Store(Load(origin[axis] + at) * reciprocal, origin_inverse[axis] + at);
    }
  }
};

}  // namespace kdray::core::KDRAY_ISA
KDRAY_END_ISA();
