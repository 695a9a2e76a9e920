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
/// ScalarSearch decides on the others, and on those at the ends of the interval. t, u and v of a
/// list are computed for several triangles together, whatever their blocks.
template <class Stored>
struct ExactAllSearch : ExactRaySearch {
  static constexpr bool kKeepsAll = true;
  // As other searches have a member: this one never ends early.
  static constexpr bool found = false;  // NOLINT(readability-identifier-naming)
  AllOfRay all;
  bool is_usual;
  std::size_t open_size;

  void Begin(const KernelJob& job, const LocalRay& local, std::size_t at) {
    BeginRay(local, at);
    all.Begin(job);
    is_usual = false;
    open_size = 0;
  }
  KDRAY_INLINE void BeginUsual(const KernelJob& job, const FrameVectors& frame,
                               const LocalRay& local, std::size_t at) {
    BeginUsualRay(job, frame, local, at);
    all.Begin(job);
    is_usual = true;
    open_size = 0;
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
                               if (is_certain || Crosses(job, ids[k])) {
                                 Take(job, ids[k], corner_at.Place(k));
                               }
                             }
                           });
  }

  struct Answers {
    void Add(const KernelJob& job, ExactAllSearch& search) {
      if (job.counts == nullptr) {
        if (search.open_size != 0) search.SolveOpen(job);
        // The hits have the caller's t already.
        if (search.all.StoreShort(job, search.row, 0)) return;
        search.KeepNearest(job);
      }
      search.all.Store(job, search.row);
    }
    void Flush(const KernelJob&) {}
  };

 private:
  static constexpr std::size_t kMostOpen = 32;
  // Work (CancelPoll) of SolveOpen for one hit.
  static constexpr std::uint64_t kSolveWork = 128;

  __attribute__((noinline)) bool Crosses(const KernelJob& job, PrimitiveId id) {
    job.poll->Spend(job.scalar->work());
    if (!is_scalar) BeginScalar(job);
    return job.scalar->Crosses(id, &space);
  }

  KDRAY_INLINE void Take(const KernelJob& job, PrimitiveId id, BlockLane at) {
    if (!all.Keeps(job, row, id, at)) return;
    if (job.counts != nullptr) {
      ++all.count;
      return;
    }
    open_[open_size++] = {id, at};
    if (open_size == kMostOpen) SolveOpen(job);
  }

  /// Computes t, u and v of the open triangles, and adds them to the list.
  __attribute__((noinline)) void SolveOpen(const KernelJob& job) {
    const std::size_t size = open_size;
    open_size = 0;
    ExactHits together;
    together.SetRay(exact);
    for (std::size_t first = 0; first < size; first += kHitLanes) {
      const std::size_t some = std::min<std::size_t>(kHitLanes, size - first);
      if (job.poll->Spend(some * kSolveWork)) return;
      for (unsigned k = 0; k < kHitLanes; ++k) {
        const Open& open = open_[first + (k < some ? k : 0)];
        for (int corner = 0; corner < 3; ++corner) {
          together.SetCorner(k, corner, CornerOf<Stored>(job, open.id, open.at, corner));
        }
      }
      alignas(64) double t[kHitLanes], u[kHitLanes], v[kHitLanes];
      const unsigned known = SolveTogether(together, t, u, v);
      for (unsigned k = 0; k < some; ++k) {
        const PrimitiveId id = open_[first + k].id;
        const double caller_t = ToCallerT(t[k], exponent);
        if ((known >> k & 1u) != 0 && IsRoundedOnce(caller_t)) {
          all.nearest.Add({caller_t, u[k], v[k], id});
        } else {
          if (job.poll->Spend(job.scalar->work())) return;
          if (!is_scalar) BeginScalar(job);
          all.nearest.Add(job.scalar->Answer(id, &space));
        }
        if (!all.nearest.IsFull()) continue;
        const double limit = KeepNearest(job);
        // The margin is more than the rounding of t and the pad of the search.
        if (is_usual) {
          cull.exit = std::min(cull.exit, OutwardHigh(ScaleByPowerOfTwo(limit, -exponent)));
        }
      }
    }
  }

  double KeepNearest(const KernelJob& job) {
    // Only hits of equal t need the scalar search.
    return all.nearest.KeepNearest(
        [&](std::span<Hit> ties) {
          if (!is_scalar) BeginScalar(job);
          job.scalar->OrderTies(ties, &space, job.poll);
        },
        job.poll);
  }

  struct Open {
    PrimitiveId id;
    BlockLane at;
  };
  Open open_[kMostOpen];
};

}  // namespace kdray::core::KDRAY_ISA
KDRAY_END_ISA();
