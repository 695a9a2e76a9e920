// SPDX-License-Identifier: Apache-2.0
// The search for all hits of a ray in the precision `watertight`.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "core/accel/wide/wide_tree.h"
#include "core/geometry/local_ray.h"
#include "core/geometry/power_of_two.h"
#include "core/kernel/kernel.h"
#include "core/kernel/simd/filters-inl.h"
#include "core/kernel/simd/isa.h"
#include "core/kernel/simd/keep-inl.h"
#include "core/kernel/simd/rays-inl.h"
#include "core/kernel/simd/search-inl.h"
#include "core/kernel/simd/vectors-inl.h"

KDRAY_BEGIN_ISA();
namespace kdray::core::KDRAY_ISA {

/// WatertightIntersection<float> on eight triangles at once. Float arithmetic decides which
/// triangles are hit. A count needs no more of those that lie in the ray's interval as a whole: s
/// is a mean of the corners' parameters. s, u and v of the others, and of all triangles of a list,
/// are computed for four of them together, whatever their blocks.
struct WatertightAllSearch : KeepAll {
  DoubleRay exact;
  float certain_enter, certain_exit;  // the interval of s, rounded inward
  std::size_t open_size;

  void Begin(const KernelJob& job, const LocalRay& local, std::size_t at) {
    BeginRounded(job, local, at);
    PrepareShear(local, &cull);
    exact.Begin(local, cull);
    open_size = 0;
    // A corner's parameter in float is off by less than 8 units of its size and the origin's, of
    // which none is beyond 5. A moved origin has another parameter.
    constexpr float kMargin = 8 * 10 * 0x1p-24f;
    const double exit = ScaleByPowerOfTwo(local.t_max, -local.exponent);
    certain_enter = OutwardHigh(ScaleByPowerOfTwo(local.t_min, -local.exponent)) + kMargin;
    certain_exit =
        std::isinf(exit) ? std::numeric_limits<float>::infinity() : OutwardLow(exit) - kMargin;
    if (local.shift != 0) certain_enter = std::numeric_limits<float>::infinity();
  }

  KDRAY_INLINE void Test(const KernelJob& job, const LeafBlock& block, unsigned lanes) {
    const ProjectedBlock p = Project(cull, block);
    const EdgeFunctions w = EdgesOf(p);
    unsigned hit = w.OneSign() & lanes;
    if (hit == 0) return;
    hit = New(job, block, hit);
    // An edge function of 0 takes exact signs.
    const F8 zero = Set8(0);
    const unsigned certain = Bits(NotEqual(w.a, zero) & NotEqual(w.b, zero) & NotEqual(w.c, zero));
    for (unsigned others = hit & ~certain; others != 0; others &= others - 1) {
      DecideByScalar(job, block.IdOf(static_cast<unsigned>(__builtin_ctz(others))), this);
    }
    hit &= certain;
    if (hit == 0) return;
    if (job.counts != nullptr) hit = CountCertain(job, block, p, hit);
    for (; hit != 0; hit &= hit - 1) {
      open_[open_size++] = {&block, static_cast<unsigned>(__builtin_ctz(hit))};
      if (open_size == kMostOpen) DecideOpen(job);
    }
  }

  struct Answers {
    void Add(const KernelJob& job, WatertightAllSearch& search) {
      if (search.open_size != 0) search.DecideOpen(job);
      KeepAll::Answers().Add(job, search);
    }
    void Flush(const KernelJob&) {}
  };

 private:
  static constexpr std::size_t kMostOpen = 32;

  /// Counts the hits in the interval whose whole triangle is. Returns those for which that is open.
  KDRAY_INLINE unsigned CountCertain(const KernelJob& job, const LeafBlock& block,
                                     const ProjectedBlock& p, unsigned hit) {
    const F8 inverse = Set8(cull.inverse[cull.axis[2]]);
    const F8 a = p.z[0] * inverse, b = p.z[1] * inverse, c = p.z[2] * inverse;
    const unsigned inside = hit & Bits(LessEqual(Set8(certain_enter), Min(Min(a, b), c)) &
                                       LessEqual(Max(Max(a, b), c), Set8(certain_exit)));
    if (job.filter == nullptr) {
      all.count += static_cast<std::uint32_t>(__builtin_popcount(inside));
      return hit & ~inside;
    }
    for (unsigned sure = inside; sure != 0; sure &= sure - 1) {
      const auto lane = static_cast<unsigned>(__builtin_ctz(sure));
      all.Take(job, row, {0, 0, 0, block.IdOf(lane)}, {&block, lane});
    }
    return hit & ~inside;
  }

  __attribute__((noinline)) void DecideOpen(const KernelJob& job) {
    // All corners are stored first, because loading a vector just after storing its numbers one by
    // one is slow.
    alignas(32) float corner[3][3][kMostOpen];
    const std::size_t size = open_size;
    open_size = 0;
    for (std::size_t i = 0; i < (size + 3) / 4 * 4; ++i) {
      const BlockLane at = open_[i < size ? i : 0];
      for (int c = 0; c < 3; ++c) {
        for (int k = 0; k < 3; ++k) corner[c][k][i] = at.block->corner[c][exact.axis[k]][at.lane];
      }
    }
    for (std::size_t first = 0; first < size; first += 4) {
      DoubleDecision decision;
      exact.DecideAlong([&](int c, int k) KDRAY_LAMBDA { return Widen4(corner[c][k] + first); },
                        &decision);
      const auto left = static_cast<unsigned>(size - first);
      const unsigned four = left >= 4 ? 15u : (1u << left) - 1;
      OfferFour(job, four & decision.inside, Load4(decision.s), decision.u, decision.v,
                open_ + first);
      for (unsigned others = four & ~decision.inside; others != 0; others &= others - 1) {
        const BlockLane at = open_[first + static_cast<unsigned>(__builtin_ctz(others))];
        DecideByScalar(job, at.block->IdOf(at.lane), this);
      }
    }
  }

  BlockLane open_[kMostOpen];
};

}  // namespace kdray::core::KDRAY_ISA
KDRAY_END_ISA();
