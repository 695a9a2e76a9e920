// SPDX-License-Identifier: Apache-2.0
// The closest hits of a packet's rays, with the triangle intersections on 16 pairs of a ray and a
// triangle. any_packet_hits-inl.h has whether there is any.
#pragma once

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "core/accel/wide/wide_tree.h"
#include "core/geometry/hit.h"
#include "core/intersect/triangle_intersection.h"
#include "core/kernel/kernel.h"
#include "core/kernel/simd/isa.h"
#include "core/kernel/simd/packet-inl.h"
#include "core/kernel/simd/packet_pairs-inl.h"
#include "core/kernel/simd/s_bound-inl.h"
#include "core/kernel/simd/search-inl.h"
#include "core/kernel/simd/vectors-inl.h"
#include "core/kernel/simd/vectors16-inl.h"

KDRAY_BEGIN_ISA();
namespace kdray::core::KDRAY_ISA {

/// 16 numbers of an array of 32 bits each, unchanged, in the lanes of set bits.
KDRAY_INLINE void SetLanes(unsigned bits, std::uint32_t value, std::uint32_t* to) {
  float* const at = reinterpret_cast<float*>(to);
  Store(Select(bits, Set16(std::bit_cast<float>(value)), Load16(at)), at);
}
KDRAY_INLINE void SetLanes(unsigned bits, F16 value, float* to) {
  Store(Select(bits, value, Load16(to)), to);
}

/// The common part of both precisions. Arrays are by place, with an extra place for discarded
/// writes. A ray whose closest hit is uncertain leaves the packet and is traced alone at the end.
struct PacketHits {
  static constexpr std::size_t kRays = FrustumRays::kRays;
  /// Blocks, and triangles with a group, above which single rays are faster.
  static constexpr std::size_t kMostWork = 800;
  std::uint64_t alone = 0;
  alignas(64) std::uint32_t found[kRays + 1];  // kNoPrimitive without a hit

  void Begin(const KernelJob&, const FrustumRays&) {
    alone = 0;
    for (std::uint32_t& f : found) f = kNoPrimitive;
  }
  KDRAY_INLINE void LeaveAlone(std::size_t place, std::uint64_t bits) { alone |= bits << place; }
  /// The rays that need no more tests.
  std::uint64_t done() const { return alone; }
};

/// Stores the hits of four rays, transposed from columns to rows, at the rays' rows; `four` is the
/// number of the four.
KDRAY_INLINE void StoreHits(const KernelJob& job, std::size_t first, const PacketOrder& order,
                            std::size_t four, D4 t, D4 u, D4 v, const std::uint32_t* found) {
  static_assert(sizeof(Hit) == 32 && offsetof(Hit, primitive_id) == 24);
  U4 id32;
  __builtin_memcpy(&id32, found + order.place_of_four[four], sizeof(id32));
  const L4 id = __builtin_convertvector(id32, L4);
  const L4 is_miss = id == L4{kNoPrimitive, kNoPrimitive, kNoPrimitive, kNoPrimitive};
  t = Select(is_miss, Set4(std::numeric_limits<double>::infinity()), t);
  u = D4(L4(u) & ~is_miss);
  v = D4(L4(v) & ~is_miss);
  const D4 tu02 = __builtin_shufflevector(t, u, 0, 4, 2, 6),
           tu13 = __builtin_shufflevector(t, u, 1, 5, 3, 7);
  const D4 vi02 = __builtin_shufflevector(v, D4(id), 0, 4, 2, 6),
           vi13 = __builtin_shufflevector(v, D4(id), 1, 5, 3, 7);
  const D4 hit[4] = {__builtin_shufflevector(tu02, vi02, 0, 1, 4, 5),
                     __builtin_shufflevector(tu13, vi13, 0, 1, 4, 5),
                     __builtin_shufflevector(tu02, vi02, 2, 3, 6, 7),
                     __builtin_shufflevector(tu13, vi13, 2, 3, 6, 7)};
  for (std::size_t k = 0; k < 4; ++k) {
    __builtin_memcpy(static_cast<void*>(&job.hits[RowAt(job, first + 4 * four + k)]), &hit[k],
                     sizeof(Hit));
  }
}

/// The closest hits of 64 rays by FastIntersection.
struct FastPacketHits : PacketHits {
  alignas(64) float s[kRays + 1], u[kRays + 1], v[kRays + 1];

  KDRAY_INLINE static std::uint32_t Axis(const FrustumRays&, std::uint32_t k) { return k; }
  KDRAY_INLINE static const float* RayRow(const FrustumRays& rays, int k) {
    return rays.direction[k];
  }
  /// The exits, by place.
  const float* exits() const { return s; }

  struct Lanes {
    unsigned accepted, certain;
    F16 s, u, v;
    AlongRay Along() const { return {accepted, certain, s, s}; }
  };
  /// Nothing: s is exact.
  struct Bounds {
    Bounds(const FrustumRays&, const CornersFromOrigin&) {}
  };
  /// Origins and rays by Axis and RayRow; `place` is a triangle's lane, or 16 lanes.
  template <class Place>
  KDRAY_INLINE static Lanes Test(const Corners16& corners, const F16 (&origin)[3],
                                 const F16 (&d)[3], const Bounds&, Place) {
    F16 b[3], c[3], from_a[3];
    for (int k = 0; k < 3; ++k) {
      b[k] = corners.at[1][k] - corners.at[0][k];
      c[k] = corners.at[2][k] - corners.at[0][k];
      from_a[k] = origin[k] - corners.at[0][k];
    }
    const F16 p[3] = {d[1] * c[2] - d[2] * c[1], d[2] * c[0] - d[0] * c[2],
                      d[0] * c[1] - d[1] * c[0]};
    const F16 q[3] = {from_a[1] * b[2] - from_a[2] * b[1], from_a[2] * b[0] - from_a[0] * b[2],
                      from_a[0] * b[1] - from_a[1] * b[0]};
    const F16 determinant = (b[0] * p[0] + b[1] * p[1]) + b[2] * p[2];
    const F16 zero = Set16(0);
    const F16 one = Set16(1);
    const F16 inverse = one / determinant;
    Lanes lanes;
    lanes.u = ((from_a[0] * p[0] + from_a[1] * p[1]) + from_a[2] * p[2]) * inverse;
    lanes.v = ((d[0] * q[0] + d[1] * q[1]) + d[2] * q[2]) * inverse;
    lanes.accepted = Bits((NotEqual(determinant, zero) & LessEqual(zero, lanes.u)) &
                          (LessEqual(lanes.u, one) & LessEqual(zero, lanes.v)) &
                          LessEqual(lanes.u + lanes.v, one));
    lanes.s = ((c[0] * q[0] + c[1] * q[1]) + c[2] * q[2]) * inverse;
    const auto gap_is_small = [&](int k) KDRAY_LAMBDA {
      const F16 gap = (from_a[k] + d[k] * lanes.s) - (b[k] * lanes.u + c[k] * lanes.v);
      return LessEqual(Abs(gap), Set16(FastIntersection::kTolerance));
    };
    lanes.certain = Bits(gap_is_small(0) & gap_is_small(1) & gap_is_small(2));
    return lanes;
  }

  KDRAY_INLINE void Take(const Lanes& lanes, const RayTrianglePairs& pairs,
                         const FrustumRays& rays) {
    unsigned accepted = lanes.accepted & pairs.lanes;
    for (unsigned doubts = accepted & ~lanes.certain; doubts != 0; doubts &= doubts - 1) {
      LeaveAlone(pairs.place[__builtin_ctz(doubts)], 1);
    }
    accepted &= lanes.certain & rays.IsInside(lanes.s, lanes.s, pairs.place);
    if (accepted == 0) return;
    alignas(64) float s_of[16], u_of[16], v_of[16];
    alignas(64) PrimitiveId numbers[16];
    pairs.Numbers(numbers);
    Store(lanes.s, s_of);
    Store(lanes.u, u_of);
    Store(lanes.v, v_of);
    for (; accepted != 0; accepted &= accepted - 1) {
      const unsigned k = static_cast<unsigned>(__builtin_ctz(accepted));
      const std::uint32_t i = pairs.place[k];
      const PrimitiveId number = numbers[k];
      const bool taken = (s_of[k] < s[i]) | ((s_of[k] == s[i]) & (number < found[i]));
      // Without an unpredictable branch: discarded results go to a place that is never read.
      const std::uint32_t to = taken ? i : kRays;
      s[to] = s_of[k];
      u[to] = u_of[k];
      v[to] = v_of[k];
      found[to] = number;
    }
  }

  KDRAY_INLINE void TakeGroup(const Lanes& lanes, const TriangleWithGroup& pairs,
                              const FrustumRays& rays) {
    unsigned accepted = lanes.accepted & pairs.lanes;
    LeaveAlone(pairs.first, accepted & ~lanes.certain);
    accepted &= lanes.certain & rays.IsInside(lanes.s, lanes.s, pairs.first);
    if (accepted == 0) return;
    const F16 before = Load16(s + pairs.first);
    const PrimitiveId number = pairs.Number();
    unsigned taken = accepted & Bits(Less(lanes.s, before));
    for (unsigned ties = accepted & Bits(LessEqual(lanes.s, before)) & ~taken; ties != 0;
         ties &= ties - 1) {
      const unsigned k = static_cast<unsigned>(__builtin_ctz(ties));
      taken |= static_cast<unsigned>(number < found[pairs.first + k]) << k;
    }
    SetLanes(taken, lanes.s, s + pairs.first);
    SetLanes(taken, lanes.u, u + pairs.first);
    SetLanes(taken, lanes.v, v + pairs.first);
    SetLanes(taken, number, found + pairs.first);
  }

  void Begin(const KernelJob& job, const FrustumRays& rays) {
    PacketHits::Begin(job, rays);
    for (float& x : s) x = std::numeric_limits<float>::infinity();
  }
  void Finish(const KernelJob& job, std::size_t first, const FrustumRays& rays) {
    const D4 zero = Set4(0);
    for (std::size_t four = 0; four < kRays / 4; ++four) {
      const std::size_t place = rays.order->place_of_four[four];
      StoreHits(job, first, *rays.order, four,
                // + 0 turns -0, the result for an origin on the triangle's plane, into 0.
                Widen4(s + place) * (Widen4(rays.scale + place) * Set4(rays.frame_scale)) + zero,
                Widen4(u + place) + zero, Widen4(v + place) + zero, found);
    }
  }
};

/// Pairs of a ray and a triangle as WatertightIntersection<float> sees them.
struct ProjectedPairs {
  F16 raw[3][3], x[3], y[3];  // corners from the origin: along the packet's axes, and projected
  F16 wa, wb, wc;             // edge functions

  KDRAY_INLINE ProjectedPairs(const Corners16& corners, const F16 (&origin)[3],
                              const F16 (&ray)[3]) {
    for (int c = 0; c < 3; ++c) {
      for (int k = 0; k < 3; ++k) raw[c][k] = corners.at[c][k] - origin[k];
      x[c] = raw[c][0] - ray[0] * raw[c][2];
      y[c] = raw[c][1] - ray[1] * raw[c][2];
    }
    wa = x[2] * y[1] - y[2] * x[1];
    wb = x[0] * y[2] - y[0] * x[2];
    wc = x[1] * y[0] - y[1] * x[0];
  }

  /// With the bounds of s; `inverse_z` is 1 / the direction along z.
  template <class Bounds, class Place>
  KDRAY_INLINE AlongRay Along(unsigned accepted, unsigned certain, F16 inverse_z,
                              const Bounds& bounds, Place place) const {
    const F16 inverse_sum = Set16(1) / ((wa + wb) + wc);
    // inverse_z lies in (1/2, 1] in size, so s is not larger than z.
    const F16 s = ((wa * raw[0][2] + wb * raw[1][2]) + wc * raw[2][2]) * inverse_sum * inverse_z;
    const SBound<F16> bound = bounds.At(raw, place);
    const F16 error = Min(bound.depth, bound.by_sum * Abs(inverse_sum)) + bound.rest;
    return {accepted, certain, s - error, s + error};
  }
};

/// The closest hits of 64 rays by WatertightIntersection<float>. Float arithmetic decides exactly
/// which triangles are hit, and bounds their s, which is defined in double. That decides all except
/// a few rays; the s of the winners is computed at the end.
struct WatertightPacketHits : PacketHits {
  // Around the s of the closest hit so far.
  alignas(64) float low[kRays + 1], high[kRays + 1];
  alignas(64) std::uint32_t slot[kRays + 1];  // its block times 8 and lane

  KDRAY_INLINE static std::uint32_t Axis(const FrustumRays& rays, std::uint32_t k) {
    return rays.axis[k];
  }
  KDRAY_INLINE static const float* RayRow(const FrustumRays& rays, int k) {
    return k < 2 ? rays.shear[k] : rays.inverse_along;
  }
  const float* exits() const { return high; }

  struct Lanes : AlongRay {
    const AlongRay& Along() const { return *this; }
  };
  /// The bounds of a block's triangles. With a common target each ray has its own origin, so the
  /// bounds are those of the pairs.
  class Bounds {
   public:
    KDRAY_INLINE Bounds(const FrustumRays& rays, const CornersFromOrigin& corners)
        : Bounds(rays, corners, rays.origin_size) {}
    KDRAY_INLINE Bounds(const FrustumRays& rays, const CornersFromOrigin& corners,
                        float origin_size)
        : of_pairs_(rays.shares_target), origin_size_(origin_size) {
      const SBound<F8> bound = BoundS(corners.at, origin_size_);
      Store(bound.depth, depth_);
      Store(bound.by_sum, by_sum_);
      Store(bound.rest, rest_);
    }
    KDRAY_INLINE SBound<F16> At(const F16 (&corners)[3][3], const std::uint32_t* lane) const {
      if (of_pairs_) return BoundS(corners, origin_size_);
      return {LookUp8(depth_, lane), LookUp8(by_sum_, lane), LookUp8(rest_, lane)};
    }
    KDRAY_INLINE SBound<F16> At(const F16 (&corners)[3][3], std::size_t lane) const {
      if (of_pairs_) return BoundS(corners, origin_size_);
      return {Set16(depth_[lane]), Set16(by_sum_[lane]), Set16(rest_[lane])};
    }

   private:
    bool of_pairs_;
    float origin_size_;
    alignas(32) float depth_[8], by_sum_[8], rest_[8];
  };
  template <class Place>
  KDRAY_INLINE static Lanes Test(const Corners16& corners, const F16 (&origin)[3],
                                 const F16 (&ray)[3], const Bounds& bounds, Place place) {
    const ProjectedPairs p(corners, origin, ray);
    const F16 zero = Set16(0);
    return {p.Along(Bits(LessEqual(zero, Min(Min(p.wa, p.wb), p.wc)) |
                         LessEqual(Max(Max(p.wa, p.wb), p.wc), zero)),
                    // An edge function of 0 takes exact signs.
                    Bits(NotEqual(p.wa, zero) & NotEqual(p.wb, zero) & NotEqual(p.wc, zero)),
                    ray[2], bounds, place)};
  }

  KDRAY_INLINE void Take(const Lanes& lanes, const RayTrianglePairs& pairs,
                         const FrustumRays& rays) {
    unsigned accepted = lanes.accepted & pairs.lanes;
    if (accepted == 0) return;
    const unsigned inside = rays.IsInside(lanes.low, lanes.high, pairs.place);
    accepted &= ~rays.IsOutside(lanes.low, lanes.high, pairs.place);
    const unsigned certain = lanes.certain & inside;
    alignas(64) float low_of[16], high_of[16];
    alignas(64) PrimitiveId numbers[16];
    pairs.Numbers(numbers);
    Store(lanes.low, low_of);
    Store(lanes.high, high_of);
    for (; accepted != 0; accepted &= accepted - 1) {
      const unsigned k = static_cast<unsigned>(__builtin_ctz(accepted));
      const std::uint32_t i = pairs.place[k];
      const PrimitiveId number = numbers[k];
      const bool taken = ((certain >> k & 1u) != 0) & (high_of[k] < low[i]);
      // The same triangle from another leaf is not a tie.
      const bool open = !taken & !(high[i] < low_of[k]) & (found[i] != number);
      if (open) Settle(rays, *pairs.block, pairs.slot + pairs.lane[k], i, certain >> k & 1u);
      // Without an unpredictable branch: discarded results go to a place that is never read.
      const std::uint32_t to = taken ? i : kRays;
      low[to] = low_of[k];
      high[to] = high_of[k];
      found[to] = number;
      slot[to] = pairs.slot + pairs.lane[k];
    }
  }

  KDRAY_INLINE void TakeGroup(const Lanes& lanes, const TriangleWithGroup& pairs,
                              const FrustumRays& rays) {
    unsigned accepted = lanes.accepted & pairs.lanes;
    if (accepted == 0) return;
    accepted &= ~rays.IsOutside(lanes.low, lanes.high, pairs.first);
    const unsigned certain = lanes.certain & rays.IsInside(lanes.low, lanes.high, pairs.first);
    const unsigned taken = accepted & certain & Bits(Less(lanes.high, Load16(low + pairs.first)));
    const PrimitiveId number = pairs.Number();
    for (unsigned open = accepted & ~taken & ~Bits(Less(Load16(high + pairs.first), lanes.low));
         open != 0; open &= open - 1) {
      const unsigned k = static_cast<unsigned>(__builtin_ctz(open));
      if (found[pairs.first + k] == number) continue;
      Settle(rays, *pairs.block, pairs.slot, pairs.first + k, certain >> k & 1u);
    }
    SetLanes(taken, lanes.low, low + pairs.first);
    SetLanes(taken, lanes.high, high + pairs.first);
    SetLanes(taken, number, found + pairs.first);
    SetLanes(taken, pairs.slot, slot + pairs.first);
  }

  /// Decides by the s of the double test whether the ray at a place keeps its closest hit or takes
  /// the triangle at another slot; leaves the ray alone where that is not enough. `certain`:
  /// whether the triangle is certainly hit within the interval.
  __attribute__((noinline)) void Settle(const FrustumRays& rays, const LeafBlock& block,
                                        std::uint32_t other_slot, std::size_t place,
                                        unsigned certain) {
    if (certain == 0 || found[place] == kNoPrimitive) return LeaveAlone(place, 1);
    // The two triangles in lanes 0 and 1.
    alignas(16) float corner[3][3][4] = {};
    const LeafBlock* const blocks = &block - other_slot / LeafBlock::kWidth;
    for (unsigned i = 0; i < 2; ++i) {
      const std::uint32_t its_slot = i == 0 ? slot[place] : other_slot;
      const LeafBlock& its_block = blocks[its_slot / LeafBlock::kWidth];
      for (int c = 0; c < 3; ++c) {
        for (int k = 0; k < 3; ++k) {
          corner[c][k][i] = its_block.corner[c][rays.axis[k]][its_slot % LeafBlock::kWidth];
        }
      }
    }
    const auto origin = [&](int k) KDRAY_LAMBDA {
      return Set4(rays.origin_double[static_cast<int>(rays.axis[k])]);
    };
    const FrustumRays::Shear shear = rays.ShearOfOne(place);
    DoubleDecision decision;
    DecideDouble([&](int c, int k) KDRAY_LAMBDA { return Widen4(corner[c][k]); }, origin(0),
                 origin(1), origin(2), shear.x, shear.y, shear.inverse_z, &decision);
    if ((decision.inside & 3u) != 3u) return LeaveAlone(place, 1);
    const PrimitiveId other = block.IdOf(other_slot % LeafBlock::kWidth);
    const bool closer = Closer(decision.s[1], other, decision.s[0], found[place]);
    if (closer) {
      found[place] = other;
      slot[place] = other_slot;
    }
    low[place] = RoundedDown(decision.s[closer ? 1 : 0]);
    high[place] = RoundedUp(decision.s[closer ? 1 : 0]);
  }

  void Begin(const KernelJob& job, const FrustumRays& rays) {
    PacketHits::Begin(job, rays);
    for (float& x : low) x = std::numeric_limits<float>::infinity();
    for (float& x : high) x = std::numeric_limits<float>::infinity();
  }

  void Finish(const KernelJob& job, std::size_t first, const FrustumRays& rays) {
    // Each ray with its triangle; all corners are stored first, because loading a vector just after
    // storing its numbers one by one is slow.
    alignas(64) float corner[3][3][kRays] = {};
    for (std::size_t four = 0; four < kRays; four += 4) {
      if (found[four] != kNoPrimitive && HaveOneTriangle(four)) {
        VisitCorners(job, rays, four, [&](std::size_t c, std::size_t k, float x) KDRAY_LAMBDA {
          StoreF4(F4{x, x, x, x}, corner[c][k] + four);
        });
        continue;
      }
      for (std::size_t i = four; i < four + 4; ++i) {
        if (found[i] == kNoPrimitive) continue;
        VisitCorners(job, rays, i, [&](std::size_t c, std::size_t k, float x) KDRAY_LAMBDA {
          corner[c][k][i] = x;
        });
      }
    }
    const auto origin = [&](int k) KDRAY_LAMBDA {
      return Set4(rays.origin_double[static_cast<int>(rays.axis[k])]);
    };
    DoubleDecision decision;
    for (std::size_t four = 0; four < kRays / 4; ++four) {
      const std::size_t place = rays.order->place_of_four[four];
      unsigned any = 0;
      for (std::size_t k = 0; k < 4; ++k) {
        any |= static_cast<unsigned>(found[place + k] != kNoPrimitive) << k;
      }
      if (any != 0) {
        const FrustumRays::Shear shear = rays.ShearAt(place);
        DecideDouble([&](int c, int k) KDRAY_LAMBDA { return Widen4(corner[c][k] + place); },
                     origin(0), origin(1), origin(2), shear.x, shear.y, shear.inverse_z, &decision);
        LeaveAlone(place, any & ~decision.inside);
      }
      StoreHits(job, first, *rays.order, four,
                Load4(decision.s) * (Widen4(rays.scale + place) * Set4(rays.frame_scale)) + Set4(0),
                Load4(decision.u), Load4(decision.v), found);
    }
  }

 private:
  // Of the rays at four places in a row; in a room that is the rule.
  KDRAY_INLINE bool HaveOneTriangle(std::size_t place) const {
    U4 numbers;
    __builtin_memcpy(&numbers, found + place, sizeof(numbers));
    const std::uint32_t one = found[place];
    const U4 differ = numbers ^ U4 { one, one, one, one };
    return (differ[0] | differ[1] | differ[2] | differ[3]) == 0;
  }

  /// visit(corner, axis, coordinate) for the triangle found by the ray at a place; the axis is one
  /// of the packet's.
  template <class Visit>
  KDRAY_INLINE void VisitCorners(const KernelJob& job, const FrustumRays& rays, std::size_t place,
                                 const Visit& visit) const {
    const LeafBlock& block = job.tree->blocks[slot[place] / LeafBlock::kWidth];
    const std::size_t lane = slot[place] % LeafBlock::kWidth;
    for (std::size_t c = 0; c < 3; ++c) {
      for (std::size_t k = 0; k < 3; ++k) visit(c, k, block.corner[c][rays.axis[k]][lane]);
    }
  }
};

}  // namespace kdray::core::KDRAY_ISA
KDRAY_END_ISA();
