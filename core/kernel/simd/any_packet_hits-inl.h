// SPDX-License-Identifier: Apache-2.0
// Whether a packet's rays hit anything.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "core/kernel/kernel.h"
#include "core/kernel/simd/isa.h"
#include "core/kernel/simd/packet-inl.h"
#include "core/kernel/simd/packet_hits-inl.h"
#include "core/kernel/simd/packet_pairs-inl.h"
#include "core/kernel/simd/vectors16-inl.h"

KDRAY_BEGIN_ISA();
namespace kdray::core::KDRAY_ISA {

/// Whether each of 64 rays hits anything, by the Test of Pairs: FastPacketHits,
/// WatertightPacketHits, or CertainPairs.
template <class Pairs>
struct AnyPacketHits {
  /// Few: rays to a visible lamp test everything on their way, while the stream kernel's rays stop
  /// at the first hit.
  static constexpr std::size_t kMostWork = 100;
  std::uint64_t alone = 0;
  std::uint64_t occluded = 0;
  alignas(64) float exit[FrustumRays::kRays];

  KDRAY_INLINE static std::uint32_t Axis(const FrustumRays& rays, std::uint32_t k) {
    return Pairs::Axis(rays, k);
  }
  KDRAY_INLINE static const float* RayRow(const FrustumRays& rays, int k) {
    return Pairs::RayRow(rays, k);
  }
  const float* exits() const { return exit; }
  std::uint64_t done() const { return alone | occluded; }

  using Lanes = typename Pairs::Lanes;
  using Bounds = typename Pairs::Bounds;
  template <class Place>
  KDRAY_INLINE static Lanes Test(const Corners16& corners, const F16 (&origin)[3],
                                 const F16 (&ray)[3], const Bounds& bounds, Place place) {
    return Pairs::Test(corners, origin, ray, bounds, place);
  }
  KDRAY_INLINE void Take(const Lanes& lanes, const RayTrianglePairs& pairs,
                         const FrustumRays& rays) {
    const AlongRay along = lanes.Along();
    const unsigned accepted = along.accepted & pairs.lanes;
    if (accepted == 0) return;
    const unsigned inside = rays.IsInside(along.low, along.high, pairs.place);
    const unsigned outside = rays.IsOutside(along.low, along.high, pairs.place);
    const unsigned hit = accepted & along.certain & inside;
    Mark(accepted & ~(along.certain & (inside | outside)), pairs.place, &alone);
    Mark(hit, pairs.place, &occluded);
  }

  KDRAY_INLINE void TakeGroup(const Lanes& lanes, const TriangleWithGroup& pairs,
                              const FrustumRays& rays) {
    const AlongRay along = lanes.Along();
    const unsigned accepted = along.accepted & pairs.lanes;
    if (accepted == 0) return;
    const unsigned inside = rays.IsInside(along.low, along.high, pairs.first);
    const unsigned outside = rays.IsOutside(along.low, along.high, pairs.first);
    const unsigned hit = accepted & along.certain & inside;
    const unsigned open = accepted & ~(along.certain & (inside | outside));
    alone |= std::uint64_t{open} << pairs.first;
    occluded |= std::uint64_t{hit} << pairs.first;
    SetLanes(hit | open, Set16(-std::numeric_limits<float>::infinity()), exit + pairs.first);
  }

  void Begin(const KernelJob&, const FrustumRays&) {
    alone = occluded = 0;
    for (float& x : exit) x = std::numeric_limits<float>::infinity();
  }
  void Finish(const KernelJob& job, std::size_t first, const FrustumRays& rays) {
    alone &= ~occluded;
    for (std::size_t four = 0; four < FrustumRays::kRays / 4; ++four) {
      const auto bits =
          static_cast<std::uint32_t>(occluded >> rays.order->place_of_four[four] & 15u);
      if (job.rows == nullptr) {
        // Bit k becomes the lowest one of byte k.
        static_assert(std::endian::native == std::endian::little);
        const std::uint32_t bytes = bits * 0x00204081u & 0x01010101u;
        __builtin_memcpy(job.occluded + first + 4 * four, &bytes, sizeof(bytes));
        continue;
      }
      for (std::size_t k = 0; k < 4; ++k) {
        job.occluded[job.rows[first + 4 * four + k]] = static_cast<std::uint8_t>(bits >> k & 1u);
      }
    }
  }

 private:
  KDRAY_INLINE void Mark(unsigned lanes, const std::uint32_t* place, std::uint64_t* set) {
    for (; lanes != 0; lanes &= lanes - 1) {
      const std::uint32_t i = place[__builtin_ctz(lanes)];
      *set |= std::uint64_t{1} << i;
      exit[i] = -std::numeric_limits<float>::infinity();
    }
  }
};

}  // namespace kdray::core::KDRAY_ISA
KDRAY_END_ISA();
