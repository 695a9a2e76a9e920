// SPDX-License-Identifier: Apache-2.0
// The search for all crossings of a ray in the precision `exact`.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <span>

#include "core/accel/wide/wide_tree.h"
#include "core/geometry/hit.h"
#include "core/geometry/local_ray.h"
#include "core/kernel/kernel.h"
#include "core/kernel/simd/exact-inl.h"
#include "core/kernel/simd/exact_hits-inl.h"
#include "core/kernel/simd/filters-inl.h"
#include "core/kernel/simd/isa.h"
#include "core/kernel/simd/keep-inl.h"
#include "core/kernel/simd/rays-inl.h"
#include "core/kernel/simd/search-inl.h"
#include "core/kernel/simd/vectors-inl.h"

KDRAY_BEGIN_ISA();
namespace kdray::core::KDRAY_ISA {

/// ExactIntersection and its OwnsCrossing on four triangles at once. A triangle whose signs double
/// arithmetic is certain about meets the ray in its inside, where it owns the crossing. The
/// ScalarSearch decides on the others, and on those at the ends of the interval. t, u and v are
/// computed when the list of hits is full, and at the end, several together.
template <class Stored>
struct ExactAllSearch : ExactRaySearch {
  static constexpr bool kKeepsAll = true;
  static constexpr bool found = false;  // the search never ends early
  AllOfRay all;
  bool is_usual;

  void Begin(const KernelJob& job, const LocalRay& local, std::size_t at) {
    BeginRay(local, at);
    all.Begin(job);
    is_usual = false;
  }
  KDRAY_INLINE void BeginUsual(const KernelJob& job, const FrameVectors& frame,
                               const LocalRay& local, std::size_t at) {
    BeginUsualRay(job, frame, local, at);
    all.Begin(job);
    is_usual = true;
  }

  KDRAY_INLINE void Test(const KernelJob& job, const LeafBlock& block, unsigned lanes) {
    VisitFours<Stored>(job, block, all.New(job, block, FilterRelaxed(cull, block) & lanes),
                       [&](const auto& corner_at, const PrimitiveId* ids, unsigned four)
                           KDRAY_LAMBDA {
                             ExactDecision decision;
                             exact.Decide(corner_at, &decision);
                             for (four &= ~decision.outside; four != 0; four &= four - 1) {
                               const unsigned k = static_cast<unsigned>(__builtin_ctz(four));
                               bool is_certain = (decision.inside >> k & 1u) != 0;
                               if (is_certain) {
                                 const double low = decision.low[k], high = decision.high[k];
                                 if (high < t_min.low || low > t_max.high) continue;
                                 is_certain = low > t_min.high && high < t_max.low;
                               }
                               Take(job, ids[k], is_certain, corner_at.Place(k));
                             }
                           });
  }

  struct Answers {
    void Add(const KernelJob& job, ExactAllSearch& search) {
      if (job.counts == nullptr) search.KeepNearest(job);
      search.all.Store(job, search.row);
    }
    void Flush(const KernelJob&) {}
  };

 private:
  __attribute__((noinline)) void Take(const KernelJob& job, PrimitiveId id, bool is_certain,
                                      BlockLane at) {
    if (!is_certain) {
      job.poll->Spend(job.scalar->work());
      if (!is_scalar) BeginScalar(job);
      if (!job.scalar->Crosses(id, &space)) return;
    }
    if (!all.Take(job, row, {std::numeric_limits<double>::quiet_NaN(), 0, 0, id}, at)) return;
    const double t = KeepNearest(job);
    // The margin is more than the rounding of t and the pad of the search.
    if (is_usual) {
      cull.exit = std::min(cull.exit, OutwardHigh(ScaleByPowerOfTwo(t, -exponent)));
    }
  }

  double KeepNearest(const KernelJob& job) {
    Solve(job, all.seen.may_repeat() ? all.nearest.DropRepeats(job.poll) : all.nearest.Unknown());
    // Only hits of equal t need the scalar search.
    return all.nearest.KeepNearest(
        [&](std::span<Hit> ties) {
          if (!is_scalar) BeginScalar(job);
          job.scalar->OrderTies(ties, &space, job.poll);
        },
        job.poll);
  }

  /// Computes t, u and v.
  void Solve(const KernelJob& job, std::span<Hit> hits) {
    ExactHits together;
    for (unsigned k = 0; k < kHitLanes; ++k) together.SetRay(k, exact);
    for (std::size_t first = 0; first < hits.size(); first += kHitLanes) {
      const std::span<Hit> some =
          hits.subspan(first, std::min<std::size_t>(kHitLanes, hits.size() - first));
      if (job.poll->Spend(some.size() * kSolveWork)) return;
      for (unsigned k = 0; k < kHitLanes; ++k) {
        const PrimitiveId id = some[k < some.size() ? k : 0].primitive_id;
        const TriangleIndices& triangle = job.mesh->triangles()[id];
        for (int corner = 0; corner < 3; ++corner) {
          together.SetCorner(
              k, corner, job.mesh->vertices<Stored>()[triangle[static_cast<std::size_t>(corner)]]);
        }
      }
      alignas(64) double t[kHitLanes], u[kHitLanes], v[kHitLanes];
      const unsigned known = SolveTogether(together, t, u, v);
      for (unsigned k = 0; k < some.size(); ++k) {
        const double caller_t = ToCallerT(t[k], exponent);
        if ((known >> k & 1u) != 0 && IsRoundedOnce(caller_t)) {
          some[k] = {caller_t, u[k], v[k], some[k].primitive_id};
          continue;
        }
        if (job.poll->Spend(job.scalar->work())) return;
        if (!is_scalar) BeginScalar(job);
        some[k] = job.scalar->Answer(some[k].primitive_id, &space);
      }
    }
  }

  // Work (CancelPoll) of Solve for one hit.
  static constexpr std::uint64_t kSolveWork = 128;
};

}  // namespace kdray::core::KDRAY_ISA
KDRAY_END_ISA();
