// SPDX-License-Identifier: Apache-2.0
// How rows become a packet of the frustum kernel: FrustumRays::Gather.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "core/geometry/local_ray.h"
#include "core/geometry/ray.h"
#include "core/kernel/kernel.h"
#include "core/kernel/simd/isa.h"
#include "core/kernel/simd/packet-inl.h"
#include "core/kernel/simd/rays-inl.h"
#include "core/kernel/simd/vectors-inl.h"
#include "core/kernel/simd/vectors16-inl.h"

KDRAY_BEGIN_ISA();
namespace kdray::core::KDRAY_ISA {

/// The first eight rays are a row of pixels, and the ninth is next to the first.
inline bool FrustumRays::IsTile(const KernelJob& job, std::size_t first) {
  const auto at = [&](std::size_t i) KDRAY_LAMBDA {
    const std::size_t row = RowAt(job, first + i);
    return job.rays.floats() != nullptr ? job.rays.floats()[row].direction
                                        : Vec3f(job.rays.doubles()[row].direction);
  };
  const Vec3f corner = at(0);
  const Vec3f along = at(7) - corner;
  const Vec3f below = at(8) - corner;
  return Dot(below, below) < 0.25f * Dot(along, along);
}

inline bool FrustumRays::SetOrigin(const MeshFrame& frame, const Vec3d& local) {
  origin_double = local;
  origin = Vec3f(local);
  origin_size = FloatAbove(MaxAbs(local));
  frame_scale = PowerOfTwo(frame.exponent);
  return MaxAbs(local) <= 4 && std::abs(frame.exponent) <= 400;
}

inline void FrustumRays::ChooseAxes(const Vec3d& d) {
  const double x = std::fabs(d.x), y = std::fabs(d.y), z = std::fabs(d.z);
  const std::uint32_t largest = x >= y ? (x >= z ? 0 : 2) : (y >= z ? 1 : 2);
  axis[2] = largest;
  axis[0] = largest == 2 ? 0 : largest + 1;
  axis[1] = axis[0] == 2 ? 0 : axis[0] + 1;
}

/// Whether two directions have one octant and shears as near each other as FindRanges asks of all.
inline bool FrustumRays::MayBeTogether(const Vec3d& a, const Vec3d& b) const {
  bool together = true;
  for (int k = 0; k < 3; ++k) together &= (a[k] < 0) == (b[k] < 0);
  const double most = shares_target ? 1 : 1.01 * static_cast<double>(kMostShear);
  const double along_a = a[static_cast<int>(axis[2])], along_b = b[static_cast<int>(axis[2])];
  for (std::size_t k = 0; k < 2; ++k) {
    const int across = static_cast<int>(axis[k]);
    together &=
        std::fabs(a[across] * along_b - b[across] * along_a) <= most * std::fabs(along_a * along_b);
  }
  return together;
}

inline FrustumRays::Form FrustumRays::Gather(const KernelJob& job, std::size_t first) {
  // Cheap checks first: most sets of rays that do not form a packet differ in their first and last
  // ray.
  const Ray one = RayAt(job, RowAt(job, first));
  const Ray other = RayAt(job, RowAt(job, first + kRays - 1));
  shares_target = !(one.origin == other.origin);
  if (shares_target) {
    if (job.occluded == nullptr) return Form::kOther;
    const Vec3d apart =
        (one.origin + one.direction * one.t_max) - (other.origin + other.direction * other.t_max);
    // FindTarget checks more precisely.
    if (!(MaxAbs(apart) * PowerOfTwo(-job.mesh->frame().exponent) < 0x1p-20)) {
      return Form::kOther;
    }
  }
  ChooseAxes(one.direction);
  if (!MayBeTogether(one.direction, other.direction)) return Form::kMixed;
  order = IsTile(job, first) ? &kTiled : &kInARow;
  given_in_double_ = job.rays.floats() == nullptr;
  const MeshFrame& frame = job.mesh->frame();
  if (!shares_target) {
    given_origin = D4{one.origin.x, one.origin.y, one.origin.z, 0};
    if (!SetOrigin(frame, frame.ToLocal(one.origin))) return Form::kOther;
  }
  Given<double> doubles;
  const Form form = given_in_double_ ? GatherDoubles(job, first, shares_target ? &doubles : nullptr)
                                     : GatherFloats(job, first);
  if (form != Form::kPacket) return form;
  const bool with_inverse = job.precision == Precision::kWatertight ||
                            (job.precision != Precision::kFast && job.occluded != nullptr);
  if (!FindRanges(with_inverse)) return Form::kMixed;
  bool has_intervals;
  if (!shares_target) {
    has_intervals = FindIntervals(job, first);
  } else if (given_in_double_) {
    has_intervals = FindTarget(frame, doubles);
  } else {
    Given<float> floats;
    GatherEnds(job, first, &floats);
    has_intervals = FindNearTarget(frame, floats) || FindTarget(frame, floats);
  }
  ahead = (octant >> axis[2] & 1u) != 0 ? -1.0f : 1.0f;
  begins_at_origin = enter >= -0x1p-18f;
  return has_intervals ? Form::kPacket : Form::kOther;
}

/// direction, shear and scale of float rays. What MakeLocalRay computes in double comes out the
/// same in float: the scaling is exact, and a quotient of floats that is rounded to double and then
/// to float is the rounded quotient (Figueroa 1995, 53 >= 2 * 24 + 2).
inline FrustumRays::Form FrustumRays::GatherFloats(const KernelJob& job, std::size_t first) {
  const RayF* rays = job.rays.floats();
  const RayF& one = rays[RowAt(job, first)];
  U4 first_origin, differs = {}, any_sign = {};
  U4 every_sign = {~0u, ~0u, ~0u, ~0u};
  __builtin_memcpy(&first_origin, &one.origin, sizeof(first_origin));
  for (std::size_t i = 0; i < kRays; i += 4) {
    F4 ray[4];
    for (std::size_t k = 0; k < 4; ++k) {
      const RayF& row = rays[RowAt(job, first + i + k)];
      __builtin_memcpy(&ray[k], &row.direction, sizeof(ray[k]));
      any_sign |= U4(ray[k]);
      every_sign &= U4(ray[k]);
      if (shares_target) continue;
      U4 from;
      __builtin_memcpy(&from, &row.origin, sizeof(from));
      differs |= from ^ first_origin;
    }
    const std::size_t place = order->place_of_four[i / 4];
    // The fourths are t_max.
    Transpose4(ray);
    for (int k = 0; k < 3; ++k) StoreF4(ray[k], direction[k] + place);
    StoreF4(ray[3], s_max + place);
  }
  if (!shares_target && (differs[0] | differs[1] | differs[2]) != 0) return Form::kOther;
  const U4 mixed = any_sign ^ every_sign;
  if (((mixed[0] | mixed[1] | mixed[2]) >> 31) != 0) return Form::kMixed;
  unsigned usual = 0xffu;
  unsigned unbounded = 0xffu;
  for (std::size_t i = 0; i < kRays; i += 8) {
    const F8 along = Load(direction[axis[2]] + i);
    usual &= Bits(LessEqual(Set8(0x1p-60f), Abs(along)) & LessEqual(Abs(along), Set8(0x1p60f)));
    unbounded &= Bits(LessEqual(Set8(std::numeric_limits<float>::infinity()), Load(s_max + i)));
    // 2^-k for the exponent k of the largest component, by its bits.
    const F8 to_local = F8(SetI8(0x7f000000u) - (I8(along) & SetI8(0x7f800000u)));
    Store(to_local, scale + i);
    for (auto& component : direction) Store(Load(component + i) * to_local, component + i);
    for (int k = 0; k < 2; ++k)
      Store(Load(direction[axis[k]] + i) / (along * to_local), shear[k] + i);
  }
  whole_lines_ = !shares_target && differs[3] == 0 && one.t_min == 0 && unbounded == 0xffu;
  return usual == 0xffu ? Form::kPacket : Form::kOther;
}

inline void FrustumRays::GatherEnds(const KernelJob& job, std::size_t first,
                                    Given<float>* given) const {
  const RayF* rays = job.rays.floats();
  for (std::size_t i = 0; i < kRays; i += 4) {
    F4 from[4], ray[4];
    for (std::size_t k = 0; k < 4; ++k) {
      const RayF& row = rays[RowAt(job, first + i + k)];
      __builtin_memcpy(&from[k], &row.origin, sizeof(from[k]));
      __builtin_memcpy(&ray[k], &row.direction, sizeof(ray[k]));
    }
    const std::size_t place = order->place_of_four[i / 4];
    Transpose4(from);
    for (int k = 0; k < 3; ++k) StoreF4(from[k], given->origin[k] + place);
    StoreF4(from[3], given->t_min + place);
    Transpose4(ray);
    StoreF4(ray[3], given->t_max + place);
  }
}

inline FrustumRays::Form FrustumRays::GatherDoubles(const KernelJob& job, std::size_t first,
                                                    Given<double>* given) {
  const Ray* rays = job.rays.doubles();
  const Ray& one = rays[RowAt(job, first)];
  whole_lines_ = true;
  for (std::size_t i = 0; i < kRays; ++i) {
    const Ray& ray = rays[RowAt(job, first + i)];
    if (given == nullptr && !(ray.origin == one.origin)) return Form::kOther;
    const std::size_t place = order->PlaceOf(i);
    if (given != nullptr) {
      for (int k = 0; k < 3; ++k) given->origin[k][place] = ray.origin[k];
      given->t_min[place] = ray.t_min;
      given->t_max[place] = ray.t_max;
    }
    for (int k = 0; k < 3; ++k) direction_double_[k][place] = ray.direction[k];
    whole_lines_ &= ray.t_min == 0 && ray.t_max == std::numeric_limits<double>::infinity();
  }
  unsigned usual = 0xfu;
  for (std::size_t i = 0; i < kRays; i += 4) {
    const D4 along = Load4(direction_double_[axis[2]] + i);
    usual &= Bits(L4(Set4(0x1p-60) <= Abs(along))) & Bits(L4(Abs(along) <= Set4(0x1p60)));
    const D4 to_local = D4(0x7fe0000000000000 - (L4(along) & 0x7ff0000000000000));
    StoreF4(Narrow(to_local), scale + i);
    for (int k = 0; k < 3; ++k) {
      const D4 local = Load4(direction_double_[k] + i) * to_local;
      Store(local, direction_double_[k] + i);
      StoreF4(Narrow(local), direction[k] + i);
    }
    for (int k = 0; k < 2; ++k) {
      StoreF4(Narrow(Load4(direction_double_[axis[k]] + i) / (along * to_local)), shear[k] + i);
    }
  }
  return usual == 0xfu ? Form::kPacket : Form::kOther;
}

/// False unless all rays have one octant, one largest axis by more than rounding, no component that
/// a cull treats as parallel, and close directions.
inline bool FrustumRays::FindRanges(bool with_inverse) {
  unsigned usual = 0xffffu;
  for (const auto& shears : shear) {
    for (std::size_t g = 0; g < kGroups; ++g) {
      const F16 s = Load16(shears + 16 * g);
      // NaN fails; Min and Max would lose it.
      usual &= Bits(LessEqual(Set16(0x1p-30f), Abs(s)) & LessEqual(Abs(s), Set16(1 - 0x1p-20f)));
    }
  }
  if (usual != 0xffffu) return false;
  for (std::size_t i = 0; with_inverse && i < kRays; i += 16) {
    Store(Set16(1) / Load16(direction[axis[2]] + i), inverse_along + i);
  }
  octant = 0;
  for (int k = 0; k < 3; ++k) {
    F16 least = Load16(direction[k]);
    F16 most = least;
    for (std::size_t g = 1; g < kGroups; ++g) {
      least = Min(least, Load16(direction[k] + 16 * g));
      most = Max(most, Load16(direction[k] + 16 * g));
    }
    const float a = Smallest(least), b = Largest(most);
    if (!(a > 0 || b < 0)) return false;
    const bool against = shares_target;
    octant |= static_cast<std::uint32_t>((b < 0) != against) << k;
    inverse_low[k] = against ? -1 / a : 1 / b;
    inverse_high[k] = against ? -1 / b : 1 / a;
  }
  is_wide = false;
  for (int k = 0; k < 2; ++k) {
    for (std::size_t g = 0; g < kGroups; ++g) {
      group_low[k][g] = Smallest(Load16(shear[k] + 16 * g));
      group_high[k][g] = Largest(Load16(shear[k] + 16 * g));
    }
    const float a = *std::min_element(group_low[k], group_low[k] + kGroups);
    const float b = *std::max_element(group_high[k], group_high[k] + kGroups);
    is_wide = is_wide || b - a > kMostShear;
    shear_middle[k] = 0.5f * (a + b);
    shear_reach[k] = 0.5f * (b - a) + 0x1p-21f;
    for (std::size_t g = 0; g < kGroups; ++g) {
      Store(Load16(shear[k] + 16 * g) - Set16(shear_middle[k]), offset[k] + 16 * g);
    }
  }
  // From an origin, packets with a wide angle would visit most of the tree.
  return !is_wide || shares_target;
}

inline bool FrustumRays::FindIntervals(const KernelJob& job, std::size_t first) {
  if (whole_lines_) {
    enter = -0x1p-20f;
    for (std::size_t i = 0; i < kRays; i += 16) {
      Store(Set16(std::numeric_limits<float>::infinity()), exit + i);
    }
    return true;
  }
  enter = std::numeric_limits<float>::infinity();
  for (std::size_t i = 0; i < kRays; ++i) {
    const Ray ray = RayAt(job, RowAt(job, first + i));
    if (!(ray.t_min <= ray.t_max)) return false;
    const std::size_t place = order->PlaceOf(i);
    t_min[place] = ray.t_min;
    t_max[place] = ray.t_max;
    const double to_caller = static_cast<double>(scale[place]) * frame_scale;
    // Scaling by a power of two is exact within the normal range.
    const double low = ray.t_min / to_caller;
    const double high = ray.t_max / to_caller;
    if ((std::fabs(low) < 0x1p-900 && ray.t_min != 0) ||
        (std::fabs(high) < 0x1p-900 && ray.t_max != 0)) {
      return false;
    }
    s_min[place] = FloatAbove(low);
    s_max[place] = FloatBelow(high);
    exit[place] = OutwardHigh(high + 0x1p-20);
    enter = std::min(enter, OutwardLow(low - 0x1p-20));
  }
  return true;
}

/// FindTarget where origins and target are at most 1 in size, in float. The distance of an end from
/// the target, at most 2^-22 as computed, is off by 2^-25 for the origin, 2^-23 for the product,
/// 2^-24 for the sum, and 2^-25 for the target: it is at most 2^-21, as FindTarget asks. False
/// where that or anything else is not certain.
inline bool FrustumRays::FindNearTarget(const MeshFrame& frame, const Given<float>& given) {
  const FrameVectors vectors(frame);
  if (std::abs(frame.exponent) > 40) return false;
  frame_scale = PowerOfTwo(frame.exponent);
  whole_lines_ = false;
  Vec3d target;
  const double to_local = 1 / (static_cast<double>(scale[0]) * frame_scale);
  for (int k = 0; k < 3; ++k) {
    target[k] =
        (static_cast<double>(given.origin[k][0]) - vectors.origin[k]) * vectors.scale +
        static_cast<double>(direction[k][0]) * (static_cast<double>(given.t_max[0]) * to_local);
  }
  if (!(MaxAbs(target) <= 1) || !SetOrigin(frame, target)) return false;
  F16 largest = Set16(0);
  unsigned usual = 0xffffu;
  for (std::size_t i = 0; i < kRays; i += 16) {
    const F16 to_caller = Load16(scale + i) * Set16(static_cast<float>(frame_scale));
    // Scaling by a power of two and back is exact, or does not give the same number.
    const F16 of_to_local = Set16(1) / to_caller;
    const F16 from = Load16(given.t_min + i), to = Load16(given.t_max + i);
    const F16 low = from * of_to_local, high = to * of_to_local;
    Store(low, s_min + i);
    Store(high, s_max + i);
    usual &= Bits(LessEqual(Set16(-0x1p20f), low) & LessEqual(low, high) &
                  LessEqual(high, Set16(0x1p20f))) &
             ~Bits(NotEqual(low * to_caller, from) | NotEqual(high * to_caller, to));
    Store((high - low) * Set16(1 + 0x1.4p-20f) + Set16(0x1p-19f), exit + i);
    for (std::size_t k = 0; k < 3; ++k) {
      const F16 local = ToLocal16(given.origin[k] + i, vectors.origin[k], vectors.scale);
      Store(local, own_origin[k] + i);
      largest = Max(largest, Abs(local));
      const F16 end = local + Load16(direction[k] + i) * high;
      const F16 apart = Abs(end - Set16(static_cast<float>(target[static_cast<int>(k)])));
      // NaN fails; Max would lose it.
      usual &= Bits(LessEqual(Abs(local), Set16(1)) & LessEqual(apart, Set16(0x1p-22f)));
    }
  }
  enter = -0x1p-19f;
  // Of the origins before they were rounded.
  origin_size = Largest(largest) + 0x1p-23f;
  return usual == 0xffffu;
}

/// Whether all rays end at one point, within the margins of culls: box tests here have errors below
/// 17 * 2^-24, of the 32 that kWidePad allows; rectangles include it in their margins; edge
/// functions have their slack.
template <class Number>
bool FrustumRays::FindTarget(const MeshFrame& frame, const Given<Number>& given) {
  constexpr double kApart = 0x1p-21;
  const FrameVectors vectors(frame);
  if (vectors.scale == 0) return false;
  frame_scale = PowerOfTwo(frame.exponent);
  whole_lines_ = false;
  double target[3];
  D4 largest = Set4(0);
  unsigned usual = 0xfu;
  for (std::size_t i = 0; i < kRays; i += 4) {
    // Of a power of two, by its bits.
    const D4 to_caller = Widen4(scale + i) * Set4(frame_scale);
    const D4 to_local = D4(0x7fe0000000000000 - L4(to_caller));
    const D4 low = Widen4(given.t_min + i) * to_local;
    const D4 high = Widen4(given.t_max + i) * to_local;
    StoreF4(Narrow(low), s_min + i);
    StoreF4(Narrow(high), s_max + i);
    // Only numbers that floats represent, without infinity.
    usual &= Bits(L4((Widen4(s_min + i) == low) & (Widen4(s_max + i) == high) & (low <= high) &
                     (Abs(low) <= Set4(0x1p20)) & (Abs(high) <= Set4(0x1p20))));
    StoreF4(Narrow((high - low) * Set4(1 + 0x1p-20) + Set4(0x1p-19)), exit + i);
    for (std::size_t k = 0; k < 3; ++k) {
      const D4 local =
          (Widen4(given.origin[k] + i) - Set4(vectors.origin[k])) * Set4(vectors.scale);
      StoreF4(Narrow(local), own_origin[k] + i);
      largest = Max(largest, Abs(local));
      const D4 end = local + DoubleDirectionAt(k, i) * high;
      if (i == 0) target[k] = end[0];
      usual &= Bits(L4((Abs(local) <= Set4(4)) & (Abs(end - Set4(target[k])) <= Set4(kApart))));
    }
  }
  enter = -0x1p-19f;
  if (usual != 0xfu || !SetOrigin(frame, {target[0], target[1], target[2]})) return false;
  origin_size = FloatAbove(std::max({largest[0], largest[1], largest[2], largest[3]}));
  return true;
}

}  // namespace kdray::core::KDRAY_ISA
KDRAY_END_ISA();
