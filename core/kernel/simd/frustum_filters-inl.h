// SPDX-License-Identifier: Apache-2.0
// The frustum kernel's culls of a block's triangles: by rectangles for each group of 16 rays, by
// edges for each ray.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "core/accel/wide/wide_tree.h"
#include "core/geometry/local_ray.h"
#include "core/kernel/simd/isa.h"
#include "core/kernel/simd/packet-inl.h"
#include "core/kernel/simd/packet_pairs-inl.h"
#include "core/kernel/simd/vectors-inl.h"
#include "core/kernel/simd/vectors16-inl.h"

KDRAY_BEGIN_ISA();
namespace kdray::core::KDRAY_ISA {

/// For each group, the lanes of a block whose triangles it may hit.
struct LanesByGroup {
  unsigned of[FrustumRays::kGroups];
  unsigned any;
  unsigned without;  // those whose triangles have no rectangle
};

/// By the triangles' rectangles in the plane of shears. Every leaf test decides on points that are
/// within kFloatPad of the ray and of the triangle. Where the triangle is z away that is kFloatPad
/// / z in shear, times what a ray's direction is longer than its z; rounding here is off by 2^-21
/// of a shear, below 1. A triangle that reaches behind the origin has no rectangle; one that lies
/// behind it is not met.
KDRAY_INLINE LanesByGroup FilterRectangles(const FrustumRays& rays,
                                           const CornersFromOrigin& corners, unsigned active) {
  constexpr float kMargin = static_cast<float>(4 * kFloatPad);
  const F8 ahead = Set8(rays.ahead);
  F8 inverse[3];
  for (int c = 0; c < 3; ++c) inverse[c] = Set8(1) / corners.at[c][2];
  const F8 along[3] = {ahead * corners.at[0][2], ahead * corners.at[1][2],
                       ahead * corners.at[2][2]};
  const F8 nearest = Min(Min(along[0], along[1]), along[2]);
  const F8 farthest = Max(Max(along[0], along[1]), along[2]);
  // NaN, where there is no triangle, is in neither.
  constexpr float kBehind = static_cast<float>(-8 * kFloatPad - 0x1p-19);
  const float least = rays.begins_at_origin ? kBehind : -std::numeric_limits<float>::infinity();
  const unsigned without =
      Bits(LessEqual(nearest, Set8(0x1p-20f)) & LessEqual(Set8(least), farthest));
  const F8 margin =
      Max(Max(Abs(inverse[0]), Abs(inverse[1])), Abs(inverse[2])) * Set8(kMargin) + Set8(0x1p-20f);
  F8 low[2], high[2];
  for (int k = 0; k < 2; ++k) {
    const F8 a = corners.at[0][k] * inverse[0];
    const F8 b = corners.at[1][k] * inverse[1];
    const F8 c = corners.at[2][k] * inverse[2];
    low[k] = Min(Min(a, b), c) - margin;
    high[k] = Max(Max(a, b), c) + margin;
  }
  const auto overlap = [&](float low_x, float high_x, float low_y, float high_y) KDRAY_LAMBDA {
    return (LessEqual(low[0], Set8(high_x)) & LessEqual(Set8(low_x), high[0])) &
           (LessEqual(low[1], Set8(high_y)) & LessEqual(Set8(low_y), high[1]));
  };
  LanesByGroup lanes = {};
  lanes.without = without;
  for (std::size_t g = 0; g < FrustumRays::kGroups; ++g) {
    const unsigned met = Bits(overlap(rays.group_low[0][g], rays.group_high[0][g],
                                      rays.group_low[1][g], rays.group_high[1][g])) |
                         without;
    lanes.of[g] = (active >> g & 1u) != 0 ? met : 0;
    lanes.any |= lanes.of[g];
  }
  return lanes;
}

/// The triangles of a block in the packet's coordinates. A test's edge function is linear in the
/// ray's shear, relative to the packet's middle. The functions of a ray that meets the triangle
/// have one sign. `positive` and `negative` say how far they may miss it: by twice what
/// FilterRelaxed allows, for both evaluations. A sign that means a hit behind the origin has
/// -infinity.
struct FrustumEdges {
  alignas(32) float middle[3][8], by_x[3][8], by_y[3][8], positive[8], negative[8];

  KDRAY_INLINE FrustumEdges(const FrustumRays& rays, const CornersFromOrigin& corners) {
    const F8 rx = Set8(rays.shear_reach[0]), ry = Set8(rays.shear_reach[1]);
    F8 x[3], y[3], z[3];
    F8 m = Set8(0);
    for (int c = 0; c < 3; ++c) {
      z[c] = corners.at[c][2];
      x[c] = corners.at[c][0] - Set8(rays.shear_middle[0]) * z[c];
      y[c] = corners.at[c][1] - Set8(rays.shear_middle[1]) * z[c];
      m = Max(m, Max(Abs(x[c]) + rx * Abs(z[c]), Abs(y[c]) + ry * Abs(z[c])));
    }
    // x_p y_q - y_p x_q, where a ray sees x - dx z and y - dy z.
    constexpr int kFrom[3] = {2, 0, 1}, kTo[3] = {1, 2, 0};
    F8 volume = Set8(0);
    for (int e = 0; e < 3; ++e) {
      const int p = kFrom[e], q = kTo[e];
      const F8 at_middle = x[p] * y[q] - y[p] * x[q];
      const F8 with_x = z[p] * y[q] - y[p] * z[q];
      const F8 with_y = x[p] * z[q] - z[p] * x[q];
      // That of the corners as vectors from the origin.
      if (e == 0) volume = (x[0] * with_x + y[0] * with_y) - z[0] * at_middle;
      Store(at_middle, middle[e]);
      Store(with_x, by_x[e]);
      Store(with_y, by_y[e]);
    }
    // Along z, a ray meets the plane at -volume / (sum of its edge functions), so the sign of the
    // volume tells which sign is ahead. It is in doubt where the origin may lie within the pads of
    // the plane. Corners are off by 2^-20, the volume then by 18 size^2 times that; rounding adds
    // 2^-18 size^3. The pads count times the normal, which is no longer than 36 size^2.
    const F8 size = Max(m, Max(Max(Abs(z[0]), Abs(z[1])), Abs(z[2])));
    constexpr float kPads = static_cast<float>(64 * (kFloatPad + 0x1p-20));
    const F8 doubt = size * size * (size * Set8(0x1p-18f) + Set8(kPads));
    const F8 toward = volume * Set8(rays.begins_at_origin ? rays.ahead : 0.0f);
    const F8 slack = m * Set8(0x1p-14f) + Set8(0x1p-33f);
    const F8 never = Set8(-std::numeric_limits<float>::infinity());
    Store(Select(Bits(LessEqual(toward, doubt)), slack, never), positive);
    Store(Select(Bits(LessEqual(Set8(0) - doubt, toward)), slack, never), negative);
  }

  /// The lanes of triangles that a group may hit, by the ranges of its shears.
  KDRAY_INLINE unsigned Lanes(const FrustumRays& rays, std::size_t group) const {
    F8 at_middle[2], reach[2];
    for (int k = 0; k < 2; ++k) {
      const float low = rays.group_low[k][group], high = rays.group_high[k][group];
      at_middle[k] = Set8(0.5f * (low + high) - rays.shear_middle[k]);
      reach[k] = Set8(0.5f * (high - low) + 0x1p-20f);
    }
    F8 least = Set8(std::numeric_limits<float>::infinity()), most = Set8(0) - least;
    for (int e = 0; e < 3; ++e) {
      const F8 x = Load(by_x[e]), y = Load(by_y[e]);
      const F8 w = NegMulAdd(at_middle[1], y, NegMulAdd(at_middle[0], x, Load(middle[e])));
      const F8 range = reach[0] * Abs(x) + reach[1] * Abs(y);
      least = Min(least, w + range);
      most = Max(most, w - range);
    }
    return Bits(LessEqual(Set8(0) - Load(positive), least)) | Bits(LessEqual(most, Load(negative)));
  }

  /// The rays of a group that may hit the triangle of a lane.
  KDRAY_INLINE unsigned Rays(const FrustumRays& rays, std::size_t group, unsigned lane) const {
    const F16 dx = Load16(rays.offset[0] + 16 * group);
    const F16 dy = Load16(rays.offset[1] + 16 * group);
    F16 w[3];
    for (int e = 0; e < 3; ++e) {
      w[e] = NegMulAdd(dy, Set16(by_y[e][lane]),
                       NegMulAdd(dx, Set16(by_x[e][lane]), Set16(middle[e][lane])));
    }
    return Bits(LessEqual(Set16(-positive[lane]), Min(Min(w[0], w[1]), w[2])) |
                LessEqual(Max(Max(w[0], w[1]), w[2]), Set16(negative[lane])));
  }
};

}  // namespace kdray::core::KDRAY_ISA
KDRAY_END_ISA();
