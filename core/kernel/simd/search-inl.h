// SPDX-License-Identifier: Apache-2.0
// One ray's search for its hits: the decisions on blocks of triangles. A search is reused for one
// ray after the other: Begin; Test for each block that the ray meets, with the lanes that may be
// hit; then its Answers::Add, which may delay the hit until Answers::Flush. What it keeps of the
// hits is in keep-inl.h.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>

#include "core/accel/wide/wide_tree.h"
#include "core/geometry/hit.h"
#include "core/geometry/local_ray.h"
#include "core/intersect/triangle_intersection.h"
#include "core/kernel/kernel.h"
#include "core/kernel/simd/filters-inl.h"
#include "core/kernel/simd/isa.h"
#include "core/kernel/simd/keep-inl.h"
#include "core/kernel/simd/rays-inl.h"
#include "core/kernel/simd/vectors-inl.h"

KDRAY_BEGIN_ISA();
namespace kdray::core::KDRAY_ISA {

/// For the few triangles that the vector form does not decide.
template <class Search>
__attribute__((noinline)) void DecideByScalar(const KernelJob& job, PrimitiveId id,
                                              Search* search) {
  job.poll->Spend(4 * job.scalar->work());
  const Ray ray = job.rays[search->row];
  const std::optional<LocalRay> local = MakeLocalRay(ray, job.mesh->frame());
  TriangleHit hit;
  if (local && job.scalar->Test(*local, id, &hit)) search->Offer(job, hit.s, hit.u, hit.v, id, {});
}

/// FastIntersection on eight triangles at once.
template <class Keep>
struct FastSearch : Keep {
  using Keep::cull, Keep::Offer, Keep::New;

  void Begin(const KernelJob& job, const LocalRay& local, std::size_t at) {
    Keep::BeginRounded(job, local, at);
  }

  KDRAY_INLINE void Test(const KernelJob& job, const LeafBlock& block, unsigned lanes) {
    F8 a[3], b[3], c[3], d[3], from_a[3];
    for (int k = 0; k < 3; ++k) {
      a[k] = Load(block.corner[0][k]);
      b[k] = Load(block.corner[1][k]) - a[k];
      c[k] = Load(block.corner[2][k]) - a[k];
      d[k] = Set8(cull.direction[k]);
      from_a[k] = Set8(cull.origin[k]) - a[k];
    }
    const F8 p[3] = {d[1] * c[2] - d[2] * c[1], d[2] * c[0] - d[0] * c[2],
                     d[0] * c[1] - d[1] * c[0]};
    const F8 determinant = (b[0] * p[0] + b[1] * p[1]) + b[2] * p[2];
    const F8 zero = Set8(0);
    const F8 one = Set8(1);
    const F8 inverse = one / determinant;
    const F8 u = ((from_a[0] * p[0] + from_a[1] * p[1]) + from_a[2] * p[2]) * inverse;
    const F8 q[3] = {from_a[1] * b[2] - from_a[2] * b[1], from_a[2] * b[0] - from_a[0] * b[2],
                     from_a[0] * b[1] - from_a[1] * b[0]};
    const F8 v = ((d[0] * q[0] + d[1] * q[1]) + d[2] * q[2]) * inverse;
    unsigned candidates = Bits((NotEqual(determinant, zero) & LessEqual(zero, u)) &
                               (LessEqual(u, one) & LessEqual(zero, v)) & LessEqual(u + v, one));
    candidates &= lanes;
    if (candidates == 0) return;
    if constexpr (Keep::kKeepsAll) {
      candidates = New(job, block, candidates);
      if (candidates == 0) return;
    }

    const F8 s = ((c[0] * q[0] + c[1] * q[1]) + c[2] * q[2]) * inverse;
    const F8 tolerance = Set8(FastIntersection::kTolerance);
    const auto gap_is_small = [&](int k) {
      return LessEqual(Abs((from_a[k] + d[k] * s) - (b[k] * u + c[k] * v)), tolerance);
    };
    const unsigned certain = Bits(gap_is_small(0) & gap_is_small(1) & gap_is_small(2));
    alignas(32) float s_of[8], u_of[8], v_of[8];
    Store(s, s_of);
    Store(u, u_of);
    Store(v, v_of);
    do {
      const unsigned lane = static_cast<unsigned>(__builtin_ctz(candidates));
      candidates &= candidates - 1;
      if ((certain >> lane & 1u) != 0) {
        Offer(job, static_cast<double>(s_of[lane]), static_cast<double>(u_of[lane]) + 0.0,
              static_cast<double>(v_of[lane]) + 0.0, block.IdOf(lane), {&block, lane});
      } else {
        DecideByScalar(job, block.IdOf(lane), this);
      }
    } while (candidates != 0);
  }
};

/// The second half of the watertight test on four triangles at once: weights and parameter for the
/// unrounded ray.
struct DoubleDecision {
  double s[4], u[4], v[4];
  unsigned inside;  ///< lanes where the ray is inside, and s is finite
};
/// corner_at(corner, axis) gives four corners' coordinates, axis 0, 1, 2 being x, y, z as the rays
/// see them; the rest is one value for all four or one for each.
template <class CornerAt>
KDRAY_INLINE void DecideDouble(const CornerAt& corner_at, D4 origin_x, D4 origin_y, D4 origin_z,
                               D4 shear_x, D4 shear_y, D4 inverse_z, DoubleDecision* decision) {
  D4 x[3], y[3], along[3];
  for (int corner = 0; corner < 3; ++corner) {
    const D4 z = corner_at(corner, 2) - origin_z;
    x[corner] = (corner_at(corner, 0) - origin_x) - shear_x * z;
    y[corner] = (corner_at(corner, 1) - origin_y) - shear_y * z;
    along[corner] = z * inverse_z;
  }
  const D4 a = DifferenceOfProducts4(x[2], y[1], y[2], x[1]);
  const D4 b = DifferenceOfProducts4(x[0], y[2], y[0], x[2]);
  const D4 c = DifferenceOfProducts4(x[1], y[0], y[1], x[0]);
  const D4 zero = Set4(0);
  const unsigned negative = Bits(L4((a < zero) | (b < zero) | (c < zero)));
  const unsigned positive = Bits(L4((a > zero) | (b > zero) | (c > zero)));
  const D4 inverse_sum = Set4(1.0) / SymmetricSum4(a, b, c);
  const D4 s = SymmetricSum4(a * along[0], b * along[1], c * along[2]) * inverse_sum;
  Store(s, decision->s);
  Store(b * inverse_sum + zero, decision->u);
  Store(c * inverse_sum + zero, decision->v);
  const D4 no_nan = s - s;  // NOLINT(misc-redundant-expression)
  decision->inside = (negative ^ positive) & Bits(L4(no_nan == zero));
}

struct DoubleRay {
  std::uint32_t axis[3];
  double origin[3];  // along axis[0], axis[1], axis[2]
  double shear[2], inverse_z;

  void Begin(const LocalRay& local, const CullRay& cull) {
    const double from[3] = {local.origin.x, local.origin.y, local.origin.z};
    for (int k = 0; k < 3; ++k) {
      axis[k] = cull.axis[k];
      origin[k] = from[axis[k]];
    }
    inverse_z = cull.inverse_z;
    shear[0] = cull.shear_double[0];
    shear[1] = cull.shear_double[1];
  }

  /// corner_at(corner, axis) gives four triangles' coordinates along an axis of the mesh.
  template <class CornerAt>
  KDRAY_INLINE void Decide(const CornerAt& corner_at, DoubleDecision* decision) const {
    DecideAlong([&](int corner, int k) KDRAY_LAMBDA { return corner_at(corner, axis[k]); },
                decision);
  }
  /// The same along an axis of the ray: 0, 1 and 2 are x, y, z as the ray sees them.
  template <class CornerAt>
  KDRAY_INLINE void DecideAlong(const CornerAt& corner_at, DoubleDecision* decision) const {
    DecideDouble(corner_at, Set4(origin[0]), Set4(origin[1]), Set4(origin[2]), Set4(shear[0]),
                 Set4(shear[1]), Set4(inverse_z), decision);
  }
};

/// WatertightIntersection<float> on eight triangles at once.
template <class Keep>
struct WatertightSearch : Keep {
  using Keep::cull, Keep::Offer, Keep::New;
  DoubleRay exact;

  void Begin(const KernelJob& job, const LocalRay& local, std::size_t at) {
    Keep::BeginRounded(job, local, at);
    PrepareShear(local, &cull);
    exact.Begin(local, cull);
  }

  KDRAY_INLINE void Test(const KernelJob& job, const LeafBlock& block, unsigned lanes) {
    const EdgeFunctions w = EdgesOf(Project(cull, block));
    const F8 zero = Set8(0);
    unsigned candidates = w.OneSign() & lanes;
    if (candidates == 0) return;
    candidates = New(job, block, candidates);
    // An edge function of 0 takes exact signs.
    const unsigned certain = Bits(NotEqual(w.a, zero) & NotEqual(w.b, zero) & NotEqual(w.c, zero));
    for (unsigned first = 0; first < 8; first += 4) {
      unsigned four = candidates >> first & 15u;
      if (four == 0) continue;
      DoubleDecision decision;
      exact.Decide([&](int corner, std::uint32_t axis)
                       KDRAY_LAMBDA { return Widen4(block.corner[corner][axis] + first); },
                   &decision);
      const unsigned decided = decision.inside & certain >> first;
      do {
        const unsigned lane = static_cast<unsigned>(__builtin_ctz(four));
        four &= four - 1;
        const PrimitiveId id = block.IdOf(first + lane);
        if ((decided >> lane & 1u) != 0) {
          Offer(job, decision.s[lane], decision.u[lane], decision.v[lane], id,
                {&block, first + lane});
        } else {
          DecideByScalar(job, id, this);
        }
      } while (four != 0);
    }
  }
};

/// Four triangles' coordinates as stored in the mesh; the first form is for blocks that contain
/// them.
struct BlockCorners {
  const LeafBlock& block;
  unsigned first;

  KDRAY_INLINE D4 operator()(int corner, std::uint32_t axis) const {
    return Widen4(block.corner[corner][axis] + first);
  }
  /// Of one of the four.
  BlockLane Place(unsigned k) const { return {&block, first + k}; }
};
struct GatheredCorners {
  alignas(32) double at[3][3][4];  // [corner][axis][lane]

  KDRAY_INLINE D4 operator()(int corner, std::uint32_t axis) const {
    return Load4(at[corner][axis]);
  }
  BlockLane Place(unsigned) const { return {}; }
};

/// Calls visit(corner_at, ids, four) for the candidates, up to four together, with one of the two
/// above; only the lanes in `four` are valid.
template <class Stored, class Visit>
KDRAY_INLINE void VisitFours(const KernelJob& job, const LeafBlock& block, unsigned candidates,
                             const Visit& visit) {
  PrimitiveId ids[4];
  if constexpr (sizeof(Stored) == sizeof(float)) {
    for (unsigned first = 0; first < 8; first += 4) {
      const unsigned four = candidates >> first & 15u;
      if (four == 0) continue;
      for (unsigned lane = 0; lane < 4; ++lane) ids[lane] = block.IdOf(first + lane);
      visit(BlockCorners{block, first}, ids, four);
    }
  } else {
    while (candidates != 0) {
      GatheredCorners corners = {};
      unsigned count = 0;
      for (; candidates != 0 && count < 4; candidates &= candidates - 1) {
        ids[count] = block.IdOf(static_cast<unsigned>(__builtin_ctz(candidates)));
        for (int corner = 0; corner < 3; ++corner) {
          const std::uint32_t index =
              job.mesh->triangles()[ids[count]][static_cast<std::size_t>(corner)];
          const Vec3d& at = job.mesh->vertices<double>()[index];
          for (int axis = 0; axis < 3; ++axis) corners.at[corner][axis][count] = at[axis];
        }
        ++count;
      }
      visit(corners, ids, (1u << count) - 1);
    }
  }
}

/// WatertightIntersection<double>, four triangles at once, with the mesh's own vertices.
template <class Keep, class Stored>
struct DoubleSearch : Keep {
  using Keep::cull, Keep::Offer, Keep::New;
  DoubleRay exact;

  void Begin(const KernelJob& job, const LocalRay& local, std::size_t at) {
    Keep::BeginRounded(job, local, at);
    PrepareShear(local, &cull);
    exact.Begin(local, cull);
  }

  KDRAY_INLINE void Test(const KernelJob& job, const LeafBlock& block, unsigned lanes) {
    VisitFours<Stored>(
        job, block, New(job, block, FilterRelaxed(cull, block) & lanes),
        [&](const auto& corner_at, const PrimitiveId* ids, unsigned four) KDRAY_LAMBDA {
          DoubleDecision decision;
          exact.Decide(corner_at, &decision);
          for (four &= decision.inside; four != 0; four &= four - 1) {
            const unsigned k = static_cast<unsigned>(__builtin_ctz(four));
            Offer(job, decision.s[k], decision.u[k], decision.v[k], ids[k], corner_at.Place(k));
          }
        });
  }
};

}  // namespace kdray::core::KDRAY_ISA
KDRAY_END_ISA();
