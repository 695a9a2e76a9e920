// SPDX-License-Identifier: Apache-2.0
// The bound of the parameter s that the watertight test computes in float.
#pragma once

#include "core/kernel/simd/isa.h"
#include "core/kernel/simd/vectors-inl.h"
#include "core/kernel/simd/vectors16-inl.h"

KDRAY_BEGIN_ISA();
namespace kdray::core::KDRAY_ISA {

/// A bound of the error of a pair's s in float, of which only the sum of the edge functions depends
/// on the ray: min(depth, by_sum / |sum|) + rest. Lanes are pairs, or a block's triangles.
template <class Lanes>
struct SBound {
  Lanes depth, by_sum, rest;
};
/// `corners` are relative to the origin, [corner][axis], along the packet's axes; origin_size is
/// the origin's largest |component|.
///
/// Numbers are off from those of the double test by, with u = 2^-24, |o| the origin's largest
/// component and Z the corners' largest z: z by u (|o| + Z); a corner's difference along x or y by
/// u (|o| + reach + Z), since it is not larger than the corner's x or y and z; the shear, at most
/// 1, by u; x and y with their own rounding by less than d = u (2 |o| + 4 Z + 3 reach). A ray
/// inside the triangle sees no corner farther from it than m = reach + 4 d, so an edge function is
/// off by at most w = 4 m d + 4 u m^2, which includes the 2 d^2 of both factors. The weights,
/// divided by their sum, are off by 6 w / |sum| together, where 3 w is a quarter of the sum at
/// most: s by half of that times the depth of the triangle, times 1 / direction, at most 1. Four
/// times as much is allowed. The rest is the rounding of z and of s itself. If the double test does
/// not find the ray inside, it takes the weights of the float projection, which are closer.
template <class Lanes>
KDRAY_INLINE SBound<Lanes> BoundS(const Lanes (&corners)[3][3], float origin_size) {
  const auto range = [&](int k) KDRAY_LAMBDA {
    return Max(Max(corners[0][k], corners[1][k]), corners[2][k]) -
           Min(Min(corners[0][k], corners[1][k]), corners[2][k]);
  };
  const auto all = [](float x) KDRAY_LAMBDA { return SetAll<Lanes>(x); };
  const Lanes depth = range(2);
  const Lanes reach = Max(range(0), range(1)) + depth;
  const Lanes far = Max(Max(Abs(corners[0][2]), Abs(corners[1][2])), Abs(corners[2][2]));
  const Lanes unit = all(0x1p-24f);
  const Lanes d = unit * (all(2 * origin_size) + all(4) * far + all(3) * reach);
  const Lanes m = reach + all(4) * d;
  const Lanes w = all(4) * m * (d + unit * m);
  return {depth, all(16) * w * depth, unit * (all(16) * far + all(2 * origin_size + 0x1p-10f))};
}

}  // namespace kdray::core::KDRAY_ISA
KDRAY_END_ISA();
