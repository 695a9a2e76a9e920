// SPDX-License-Identifier: Apache-2.0
// The search of the precision `exact`: ExactIntersection's filter on four triangles at once.
#pragma once

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>

#include "core/accel/wide/wide_tree.h"
#include "core/geometry/local_ray.h"
#include "core/intersect/exact_intersection.h"
#include "core/intersect/rounded_ray.h"
#include "core/kernel/kernel.h"
#include "core/kernel/simd/exact_hits-inl.h"
#include "core/kernel/simd/filters-inl.h"
#include "core/kernel/simd/isa.h"
#include "core/kernel/simd/keep-inl.h"
#include "core/kernel/simd/rays-inl.h"
#include "core/kernel/simd/search-inl.h"
#include "core/kernel/simd/vectors-inl.h"

KDRAY_BEGIN_ISA();
namespace kdray::core::KDRAY_ISA {

/// Decisions of double arithmetic on four triangles.
struct ExactDecision {
  unsigned outside;        ///< lanes that are certainly not hit
  unsigned inside;         ///< lanes that are certainly hit; for the others the bounds are invalid
  double low[4], high[4];  ///< bounds of the exact local parameter of LocalRay
};

/// Decides on four pairs of a ray and a triangle; each number is one for all four or one for each.
/// corner_at(corner, axis) gives the triangles' coordinates; `axis` is that of the directions'
/// largest component, `inverse` 1 / that. For the errors see ExactRay; origin_rounding is
/// RoundedRay's.
///
/// One bound serves a triangle's three volumes, product_error * m^2 + origin_error * m, where no
/// coordinate is beyond m: an edge's products add up to no more than 2 (|dx| + |dy| + |dz|) m^2.
/// It is more than four times RoundedRay's bound (fused products are off by less than its own).
template <class CornerAt>
KDRAY_INLINE void DecideExact(const CornerAt& corner_at, const D4 (&origin)[3],
                              const D4 (&direction)[3], int axis, D4 inverse, D4 product_error,
                              double origin_rounding, ExactDecision* decision) {
  D4 at[3][3], size[3];
  for (int corner = 0; corner < 3; ++corner) {
    for (int k = 0; k < 3; ++k) at[corner][k] = corner_at(corner, k) - origin[k];
    size[corner] = Max(Max(Abs(at[corner][0]), Abs(at[corner][1])), Abs(at[corner][2]));
  }
  const D4 m = Max(Max(size[0], size[1]), size[2]);
  const auto volume_of = [&](const D4* p, const D4* q) KDRAY_LAMBDA {
    const D4 x = MulSub(p[1], q[2], p[2] * q[1]);
    const D4 y = MulSub(p[2], q[0], p[0] * q[2]);
    const D4 z = MulSub(p[0], q[1], p[1] * q[0]);
    return MulAdd(direction[0], x, MulAdd(direction[1], y, direction[2] * z));
  };
  const D4 a = volume_of(at[1], at[2]), b = volume_of(at[2], at[0]), c = volume_of(at[0], at[1]);
  // The last term: if a sum of volumes is larger, nothing below underflows.
  const D4 origin_error = Set4(9 * RoundedRay::kOrigin * origin_rounding);
  const D4 error = MulAdd(MulAdd(product_error, m, origin_error), m, Set4(0x1p-900));
  const D4 least = Min(Min(a, b), c);
  const D4 most = Max(Max(a, b), c);
  // NaN, from unbounded errors, is neither.
  decision->outside = Bits(L4((least < -error) & (most > error)));
  decision->inside = Bits(L4((least > error) | (most < -error)));
  if (decision->inside == 0) return;

  // If all signs are certain, the hit's parameter s is the mean of the corners' along[i], weighted
  // by the volumes. An error in a volume moves it by at most the error's fraction of the sum, times
  // the distance between the corners' parameters, and the three errors are less than error * 3 / 4;
  // each parameter is off by 4 units and the origin's rounding; the mean's own arithmetic adds some
  // 8 units, and the bounds one each. All that, doubled; the last term is for underflow. No
  // parameter is beyond m, since the direction's longest component is at least 1.
  D4 along[3];
  for (int corner = 0; corner < 3; ++corner) along[corner] = at[corner][axis] * inverse;
  const D4 low = Min(Min(along[0], along[1]), along[2]);
  const D4 high = Max(Max(along[0], along[1]), along[2]);
  const D4 inverse_sum = Set4(1.0) / (a + b + c);
  const D4 s = (a * along[0] + b * along[1] + c * along[2]) * inverse_sum;
  const D4 error_of_s = Set4(2) * error * Abs(inverse_sum) * (high - low) + m * Set4(0x1p-48) +
                        Set4(8 * origin_rounding + 0x1p-150);
  Store(s - error_of_s, decision->low);
  Store(s + error_of_s, decision->high);
}

/// Sets the origin of a usual ray (PrepareUsual): as given, and local.
KDRAY_INLINE void SetUsualOrigin(D4 given, const FrameVectors& frame, const Vec3d& local,
                                 RoundedRay* ray) {
  ray->origin = local;
  // The rounding error of the difference, exactly (TwoDifference).
  const D4 moved = given - frame.origin;
  const D4 part = moved - given;
  const D4 rest = (given - (moved - part)) - (frame.origin + part);
  const D4 low = rest * Set4(frame.scale);
  const D4 size = Abs(low);
  // Underflow in scaling is negligible beside kUnderflow.
  ray->origin_low = {low[0], low[1], low[2]};
  ray->origin_error = 0;
  ray->origin_rounding = std::max({size[0], size[1], size[2]});
  ray->shift = ray->shift_low = 0;
}

/// RoundedRay::BoundOf for a ray whose origin was not moved; t is local.
KDRAY_INLINE RoundedRay::Bound BoundOf(double t) {
  const double room = std::copysign(0x1p-48, t);
  return {t * (1 - room), t * (1 + room)};
}

/// ExactIntersection's form of a ray, for vectors of triangles.
struct ExactRay : RoundedRay {
  /// Of the sum of the direction's components, for DecideExact.
  static constexpr double kProductError = 9 * kProducts;
  std::uint32_t axis;    // of the direction's largest component
  double inverse;        // of that component
  double product_error;  // see DecideExact

  void Begin(const LocalRay& local, const CullRay& cull) {
    static_cast<RoundedRay&>(*this) = RoundedRay(local);
    axis = cull.axis[2];
    inverse = cull.inverse_z;
    SetError();
  }

  /// The same for a ray of PrepareUsual.
  KDRAY_INLINE void BeginUsual(const GivenRay& given, const FrameVectors& frame,
                               const LocalRay& local, const CullRay& cull) {
    direction = local.direction;
    SetUsualOrigin(given.from, frame, local.origin, this);
    axis = cull.axis[2];
    inverse = cull.inverse_z;
    SetError();
  }

  /// corner_at(corner, axis) gives four triangles' coordinates along an axis of the mesh.
  template <class CornerAt>
  KDRAY_INLINE void Decide(const CornerAt& corner_at, ExactDecision* decision) const {
    const D4 from[3] = {Set4(origin.x), Set4(origin.y), Set4(origin.z)};
    const D4 to[3] = {Set4(direction.x), Set4(direction.y), Set4(direction.z)};
    DecideExact([&](int corner, int k)
                    KDRAY_LAMBDA { return corner_at(corner, static_cast<std::uint32_t>(k)); },
                from, to, static_cast<int>(axis), Set4(inverse), Set4(product_error),
                origin_rounding, decision);
  }

 private:
  void SetError() {
    product_error =
        kProductError * (std::fabs(direction.x) + std::fabs(direction.y) + std::fabs(direction.z));
  }
};

/// The common part of searches in `exact`: the ray, its interval, and its scalar search.
struct ExactRaySearch {
  static constexpr bool kBeginsUsual = true;
  CullRay cull;
  std::size_t row;
  ExactRay exact;
  int exponent;
  RoundedRay::Bound t_min, t_max;  // the caller's interval, local
  bool is_scalar;
  ScalarSearchSpace space;  // once is_scalar

  static std::optional<LocalRay> MakeRay(const Ray& ray, const MeshFrame& frame) {
    return MakeExactLocalRay(ray, frame);
  }
  void BeginRay(const LocalRay& local, std::size_t at) {
    PrepareShear(local, &cull);
    exact.Begin(local, cull);
    row = at;
    exponent = local.exponent;
    is_scalar = false;
    t_min = RoundedRay::BoundOf(local.t_min, local);
    t_max = RoundedRay::BoundOf(local.t_max, local);
  }
  KDRAY_INLINE void BeginUsualRay(const KernelJob& job, const FrameVectors& frame,
                                  const LocalRay& local, std::size_t at) {
    PrepareShear(local, &cull);
    exact.BeginUsual(LoadRay(job.rays, at), frame, local, cull);
    row = at;
    exponent = local.exponent;
    is_scalar = false;
    const double to_local = PowerOfTwo(-local.exponent);
    t_min = BoundOf(local.t_min * to_local);
    t_max = BoundOf(local.t_max * to_local);
  }
  __attribute__((noinline)) void BeginScalar(const KernelJob& job) {
    is_scalar = true;
    const Ray ray = job.rays[row];
    const std::optional<LocalRay> local = MakeRay(ray, job.mesh->frame());
    job.scalar->Begin(*local, &space);
  }
};

/// A triangle's corner as the mesh has it: from its block if that has the mesh's own corners, which
/// are floats.
template <class Stored>
KDRAY_INLINE Vec3<Stored> CornerOf(const KernelJob& job, PrimitiveId id, BlockLane at, int corner) {
  if constexpr (sizeof(Stored) == sizeof(float)) {
    const auto& from = at.block->corner[corner];
    return {from[0][at.lane], from[1][at.lane], from[2][at.lane]};
  } else {
    const TriangleIndices& triangle = job.mesh->triangles()[id];
    return job.mesh->template vertices<Stored>()[triangle[static_cast<std::size_t>(corner)]];
  }
}

/// ExactIntersection on four triangles at once, while double arithmetic is certain about all signs
/// and about the smaller t. At the first doubt the ray goes to the ScalarSearch, which then gets
/// every triangle that may be hit.
template <class Stored>
struct ExactSearch : ExactRaySearch {
  static constexpr bool kKeepsAll = false;
  using Answers = ExactAnswers;
  bool found;
  PrimitiveId best_id;
  double best_low, best_high;  // bounds of the best s
  BlockLane best_at;

  void Begin(const KernelJob&, const LocalRay& local, std::size_t at) {
    BeginRay(local, at);
    BeginEmpty();
  }
  KDRAY_INLINE void BeginUsual(const KernelJob& job, const FrameVectors& frame,
                               const LocalRay& local, std::size_t at) {
    BeginUsualRay(job, frame, local, at);
    BeginEmpty();
  }

  KDRAY_INLINE void Test(const KernelJob& job, const LeafBlock& block, unsigned lanes) {
    VisitFours<Stored>(
        job, block, FilterRelaxed(cull, block) & lanes,
        [&](const auto& corner_at, const PrimitiveId* ids, unsigned four) KDRAY_LAMBDA {
          ExactDecision decision;
          exact.Decide(corner_at, &decision);
          for (four &= ~decision.outside; four != 0; four &= four - 1) {
            const unsigned k = static_cast<unsigned>(__builtin_ctz(four));
            const Verdict verdict = is_scalar || (decision.inside >> k & 1u) == 0
                                        ? Verdict::kDoubt
                                        : Compare(decision.low[k], decision.high[k], ids[k]);
            if (verdict == Verdict::kDoubt) OfferToScalar(job, ids[k]);
            if (verdict != Verdict::kCloser) continue;
            const BlockLane at = corner_at.Place(k);
            if (job.filter != nullptr && !FilterKeeps(job, row, ids[k], at)) continue;
            found = true;
            best_id = ids[k];
            best_low = decision.low[k];
            best_high = decision.high[k];
            cull.exit = std::min(cull.exit, RoundedUp(best_high + kDoublePad));
            best_at = at;
          }
        });
  }

  /// Of the closest triangle, as the mesh has it.
  KDRAY_INLINE Vec3<Stored> BestCorner(const KernelJob& job, int corner) const {
    return CornerOf<Stored>(job, best_id, best_at, corner);
  }

 private:
  KDRAY_INLINE void BeginEmpty() {
    found = false;
    best_id = kNoPrimitive;
  }

  enum class Verdict { kCloser, kNotCloser, kDoubt };
  /// Compares a triangle that is certainly hit with the best so far, and with the interval.
  KDRAY_INLINE Verdict Compare(double low, double high, PrimitiveId id) const {
    if (id == best_id || (found && low > best_high)) return Verdict::kNotCloser;
    if (high < t_min.low || low > t_max.high) return Verdict::kNotCloser;
    if (found && !(high < best_low)) return Verdict::kDoubt;
    const bool in_interval = low > t_min.high && high < t_max.low;
    return in_interval ? Verdict::kCloser : Verdict::kDoubt;
  }

  __attribute__((noinline)) void OfferToScalar(const KernelJob& job, PrimitiveId id) {
    job.poll->Spend(job.scalar->work());
    if (!is_scalar) {
      BeginScalar(job);
      if (found) job.scalar->Offer(best_id, &space);
    }
    if (!job.scalar->Offer(id, &space)) return;
    found = true;
    cull.exit = std::min(cull.exit, RoundedUp(job.scalar->Limit(space)));
  }
};

}  // namespace kdray::core::KDRAY_ISA
KDRAY_END_ISA();
