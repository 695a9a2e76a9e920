// SPDX-License-Identifier: Apache-2.0
// The triangle intersection of packets that ask for any hit in `double` and `exact`: float
// arithmetic decides where it is certain of what these precisions find.
#pragma once

#include <cstdint>

#include "core/kernel/simd/isa.h"
#include "core/kernel/simd/packet-inl.h"
#include "core/kernel/simd/packet_hits-inl.h"
#include "core/kernel/simd/packet_pairs-inl.h"
#include "core/kernel/simd/vectors16-inl.h"

KDRAY_BEGIN_ISA();
namespace kdray::core::KDRAY_ISA {

/// What AnyPacketHits needs of a precision: Axis, RayRow, Lanes, Bounds and Test.
///
/// With u = 2^-24 and R = 1 + the origin's largest |component| <= 5, a corner is off along z by 2uR
/// (the origin and the difference) and by u / 2 (a vertex in double, rounded to float), and along x
/// and y by 9uR (these, as much times the shear, 2uR for the shear and its product with z, and 2uR
/// for the last difference). Shears are at most 1, so projected corners are at most m <= 2R. An
/// edge function is off by less than 4 (m + 9uR) 9uR + 2 (9uR)^2 for its numbers and 4um^2 <= 8uRm
/// for its arithmetic: together less than 44uRm + 2^-34. 48uRm is allowed. Beyond that its sign is
/// that of the exact one, and of the one in double, whose error is far smaller.
///
/// SBound is for the double test with the same corners. Where all signs are certain, edge functions
/// are off by less than a fraction of themselves, and so are the weights: it bounds the exact s,
/// too. A vertex in double is off as much as if the origin were larger by 1/2.
struct CertainPairs {
  KDRAY_INLINE static std::uint32_t Axis(const FrustumRays& rays, std::uint32_t k) {
    return WatertightPacketHits::Axis(rays, k);
  }
  KDRAY_INLINE static const float* RayRow(const FrustumRays& rays, int k) {
    return WatertightPacketHits::RayRow(rays, k);
  }

  using Lanes = WatertightPacketHits::Lanes;
  struct Bounds : WatertightPacketHits::Bounds {
    float of_size;  // of an edge function's error, to m

    KDRAY_INLINE Bounds(const FrustumRays& rays, const CornersFromOrigin& corners)
        : WatertightPacketHits::Bounds(rays, corners, rays.origin_size + 0.5f),
          of_size((1 + rays.origin_size) * (48 * 0x1p-24f)) {}
  };
  template <class Place>
  KDRAY_INLINE static Lanes Test(const Corners16& corners, const F16 (&origin)[3],
                                 const F16 (&ray)[3], const Bounds& bounds, Place place) {
    const ProjectedPairs p(corners, origin, ray);
    F16 size = Set16(0);
    for (int c = 0; c < 3; ++c) size = Max(size, Max(Abs(p.x[c]), Abs(p.y[c])));
    const F16 error = size * Set16(bounds.of_size) + Set16(0x1p-34f);
    const F16 least = Min(Min(p.wa, p.wb), p.wc), most = Max(Max(p.wa, p.wb), p.wc);
    const F16 below = Set16(0) - error;
    return {p.Along(Bits(LessEqual(below, least) | LessEqual(most, error)),
                    Bits(Less(error, least) | Less(most, below)), ray[2], bounds, place)};
  }
};

}  // namespace kdray::core::KDRAY_ISA
KDRAY_END_ISA();
