// SPDX-License-Identifier: Apache-2.0
// The closest hits of a packet's rays in `double` and `exact`, which decide on the mesh's own
// vertices in double: four pairs of a ray and a triangle at a time, of those that the packet's
// edges have left.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>

#include "core/accel/wide/wide_tree.h"
#include "core/geometry/hit.h"
#include "core/intersect/rounded_ray.h"
#include "core/kernel/kernel.h"
#include "core/kernel/simd/exact-inl.h"
#include "core/kernel/simd/exact_hits-inl.h"
#include "core/kernel/simd/isa.h"
#include "core/kernel/simd/packet-inl.h"
#include "core/kernel/simd/packet_hits-inl.h"
#include "core/kernel/simd/packet_pairs-inl.h"
#include "core/kernel/simd/rays-inl.h"
#include "core/kernel/simd/search-inl.h"
#include "core/kernel/simd/vectors-inl.h"
#include "core/kernel/simd/vectors16-inl.h"

KDRAY_BEGIN_ISA();
namespace kdray::core::KDRAY_ISA {

/// Four pairs of a ray and a triangle, of which those of `open` are valid. `certain` is as
/// AlongRay.
struct FourPairs {
  unsigned open, certain;
  std::uint32_t place[4];  // of the rays
  std::uint32_t slot[4];   // of the triangles: the number of a block times 8, and the lane
  PrimitiveId number[4];   // of the triangles
};

/// The common part of both precisions. Derived::Decide(pairs, corner_at, numbers_at, rays) decides
/// on four pairs: corner_at(corner, axis) as DecideDouble has it, numbers_at(array) an array's
/// numbers at the rays' places.
template <class Derived, class Stored>
struct StoredPacketHits : PacketHits {
  alignas(64) float exit[kRays];  // by place: where the ray's search ends

  KDRAY_INLINE static std::uint32_t Axis(const FrustumRays& rays, std::uint32_t k) {
    return rays.axis[k];
  }
  KDRAY_INLINE static const float* RayRow(const FrustumRays& rays, int k) {
    return rays.direction[k];  // not used
  }
  const float* exits() const { return exit; }

  /// Every pair is open. The corners are the mesh's own if those are floats.
  struct Lanes {
    unsigned accepted = 0xffffu, certain = 0xffffu;
    alignas(64) float corner[3][3][16];
  };
  struct Bounds {
    Bounds(const FrustumRays&, const CornersFromOrigin&) {}
  };
  template <class Place>
  KDRAY_INLINE static Lanes Test(const Corners16& corners, const F16 (&)[3], const F16 (&)[3],
                                 const Bounds&, Place) {
    Lanes lanes;
    for (int c = 0; kAreFloats && c < 3; ++c) {
      for (int k = 0; k < 3; ++k) Store(corners.at[c][k], lanes.corner[c][k]);
    }
    return lanes;
  }

  void Begin(const KernelJob& job, const FrustumRays& rays) {
    PacketHits::Begin(job, rays);
    job_ = &job;
    for (float& x : exit) x = std::numeric_limits<float>::infinity();
  }

  KDRAY_INLINE void Take(const Lanes& lanes, const RayTrianglePairs& pairs,
                         const FrustumRays& rays) {
    alignas(64) PrimitiveId numbers[16];
    pairs.Numbers(numbers);
    for (unsigned first = 0; first < 16; first += 4) {
      FourPairs four = {
          (lanes.accepted & pairs.lanes) >> first & 15u, lanes.certain >> first, {}, {}, {}};
      if (four.open == 0) continue;
      for (unsigned k = 0; k < 4; ++k) {
        // Places after the last pair are unspecified.
        four.place[k] = pairs.place[first + k] % kRays;
        four.slot[k] = pairs.slot + pairs.lane[first + k];
        four.number[k] = numbers[first + k];
      }
      const auto numbers_at = [&](const double* from) KDRAY_LAMBDA {
        return D4{from[four.place[0]], from[four.place[1]], from[four.place[2]],
                  from[four.place[3]]};
      };
      DecideFour(lanes, first, four, numbers_at, rays);
    }
  }

  KDRAY_INLINE void TakeGroup(const Lanes& lanes, const TriangleWithGroup& pairs,
                              const FrustumRays& rays) {
    for (unsigned first = 0; first < 16; first += 4) {
      FourPairs four = {
          (lanes.accepted & pairs.lanes) >> first & 15u, lanes.certain >> first, {}, {}, {}};
      if (four.open == 0) continue;
      const std::size_t begin = pairs.first + first;
      for (unsigned k = 0; k < 4; ++k) {
        four.place[k] = static_cast<std::uint32_t>(begin) + k;
        four.slot[k] = pairs.slot;
        four.number[k] = pairs.Number();
      }
      const auto numbers_at = [&](const double* from) KDRAY_LAMBDA { return Load4(from + begin); };
      DecideFour(lanes, first, four, numbers_at, rays);
    }
  }

 protected:
  static constexpr bool kAreFloats = sizeof(Stored) == sizeof(float);

  /// The rays' common origin along an axis of the packet.
  KDRAY_INLINE static D4 OriginAlong(const FrustumRays& rays, int k) {
    return Set4(rays.origin_double[static_cast<int>(rays.axis[k])]);
  }
  /// The caller's t of four rays in a row, from their local parameters.
  KDRAY_INLINE static D4 CallerT(const FrustumRays& rays, std::size_t place, D4 along) {
    // + 0 turns -0 into 0.
    return along * (Widen4(rays.scale + place) * Set4(rays.frame_scale)) + Set4(0);
  }

  const KernelJob* job_ = nullptr;

 private:
  template <class NumbersAt>
  KDRAY_INLINE void DecideFour(const Lanes& lanes, unsigned first, const FourPairs& four,
                               const NumbersAt& numbers_at, const FrustumRays& rays) {
    Derived* const derived = static_cast<Derived*>(this);
    if constexpr (kAreFloats) {
      const auto corner_at = [&](int c, int k)
                                 KDRAY_LAMBDA { return Widen4(lanes.corner[c][k] + first); };
      derived->Decide(four, corner_at, numbers_at, rays);
    } else {
      alignas(32) double corner[3][3][4] = {};
      for (unsigned open = four.open; open != 0; open &= open - 1) {
        const auto lane = static_cast<std::size_t>(__builtin_ctz(open));
        const TriangleIndices& triangle = job_->mesh->triangles()[four.number[lane]];
        for (std::size_t c = 0; c < 3; ++c) {
          const Vec3d& vertex = job_->mesh->template vertices<double>()[triangle[c]];
          for (std::size_t k = 0; k < 3; ++k) {
            corner[c][k][lane] = vertex[static_cast<int>(rays.axis[k])];
          }
        }
      }
      const auto corner_at = [&](int c, int k) KDRAY_LAMBDA { return Load4(corner[c][k]); };
      derived->Decide(four, corner_at, numbers_at, rays);
    }
  }
};

/// The closest hits of 64 rays by WatertightIntersection<double>.
template <class Stored>
struct DoublePacketHits : StoredPacketHits<DoublePacketHits<Stored>, Stored> {
  using Base = StoredPacketHits<DoublePacketHits<Stored>, Stored>;
  using Base::exit, Base::found, Base::kRays;

  void Begin(const KernelJob& job, const FrustumRays& rays) {
    Base::Begin(job, rays);
    for (double& x : s_) x = std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i < kRays; i += 4) {
      const FrustumRays::Shear shear = rays.ShearAt(i);
      Store(shear.x, shear_x_ + i);
      Store(shear.y, shear_y_ + i);
      Store(shear.inverse_z, inverse_z_ + i);
    }
  }

  template <class CornerAt, class NumbersAt>
  KDRAY_INLINE void Decide(const FourPairs& pairs, const CornerAt& corner_at,
                           const NumbersAt& numbers_at, const FrustumRays& rays) {
    DoubleDecision decision;
    DecideDouble(corner_at, Base::OriginAlong(rays, 0), Base::OriginAlong(rays, 1),
                 Base::OriginAlong(rays, 2), numbers_at(shear_x_), numbers_at(shear_y_),
                 numbers_at(inverse_z_), &decision);
    for (unsigned open = pairs.open & decision.inside; open != 0; open &= open - 1) {
      const auto k = static_cast<std::size_t>(__builtin_ctz(open));
      const std::uint32_t i = pairs.place[k];
      if (!Closer(decision.s[k], pairs.number[k], s_[i], found[i])) continue;
      if (!rays.IsInInterval(decision.s[k], i)) continue;
      if ((pairs.certain >> k & 1u) == 0) {
        Base::LeaveAlone(i, 1);
        continue;
      }
      s_[i] = decision.s[k];
      u_[i] = decision.u[k];
      v_[i] = decision.v[k];
      found[i] = pairs.number[k];
      exit[i] = RoundedUp(decision.s[k]);
    }
  }

  void Finish(const KernelJob& job, std::size_t first, const FrustumRays& rays) {
    for (std::size_t four = 0; four < kRays / 4; ++four) {
      const std::size_t i = rays.order->place_of_four[four];
      StoreHits(job, first, *rays.order, four, Base::CallerT(rays, i, Load4(s_ + i)), Load4(u_ + i),
                Load4(v_ + i), found);
    }
  }

 private:
  // By place; the hit is the closest so far.
  alignas(64) double s_[kRays], u_[kRays], v_[kRays];
  alignas(64) double shear_x_[kRays], shear_y_[kRays], inverse_z_[kRays];
};

/// The closest hits of 64 rays by ExactIntersection, while double arithmetic is certain about all
/// signs and about the smaller t.
template <class Stored>
struct ExactPacketHits : StoredPacketHits<ExactPacketHits<Stored>, Stored> {
  using Base = StoredPacketHits<ExactPacketHits<Stored>, Stored>;
  using Base::exit, Base::found, Base::kRays;

  void Begin(const KernelJob& job, const FrustumRays& rays) {
    Base::Begin(job, rays);
    SetUsualOrigin(rays.given_origin, FrameVectors(job.mesh->frame()), rays.origin_double,
                   &origin_);
    for (double& x : low_) x = std::numeric_limits<double>::infinity();
    for (double& x : high_) x = std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i < kRays; i += 4) {
      D4 along[3];
      for (std::size_t k = 0; k < 3; ++k) {
        along[k] = rays.DoubleDirectionAt(rays.axis[k], i);
        Store(along[k], direction_[k] + i);
      }
      Store(Set4(1) / along[2], inverse_ + i);
      Store(Set4(ExactRay::kProductError) * (Abs(along[0]) + Abs(along[1]) + Abs(along[2])),
            product_error_ + i);
    }
  }

  template <class CornerAt, class NumbersAt>
  KDRAY_INLINE void Decide(const FourPairs& pairs, const CornerAt& corner_at,
                           const NumbersAt& numbers_at, const FrustumRays& rays) {
    const D4 origin[3] = {Base::OriginAlong(rays, 0), Base::OriginAlong(rays, 1),
                          Base::OriginAlong(rays, 2)};
    // The axes are in cyclic order, so volumes keep their signs.
    const D4 direction[3] = {numbers_at(direction_[0]), numbers_at(direction_[1]),
                             numbers_at(direction_[2])};
    ExactDecision decision;
    DecideExact(corner_at, origin, direction, 2, numbers_at(inverse_), numbers_at(product_error_),
                origin_.origin_rounding, &decision);
    for (unsigned open = pairs.open & ~decision.outside; open != 0; open &= open - 1) {
      const auto k = static_cast<std::size_t>(__builtin_ctz(open));
      const std::uint32_t i = pairs.place[k];
      // From another leaf.
      if (pairs.number[k] == found[i]) continue;
      bool is_certain = (pairs.certain & decision.inside) >> k & 1u;
      if ((decision.inside >> k & 1u) != 0) {
        const double low = decision.low[k], high = decision.high[k];
        const RoundedRay::Bound t_min = BoundOf(rays.LocalStart(i));
        const RoundedRay::Bound t_max = BoundOf(rays.LocalEnd(i));
        if (low > high_[i] || high < t_min.low || low > t_max.high) continue;
        is_certain = is_certain && high < low_[i] && low > t_min.high && high < t_max.low;
      }
      if (!is_certain) {
        Base::LeaveAlone(i, 1);
        continue;
      }
      low_[i] = decision.low[k];
      high_[i] = decision.high[k];
      found[i] = pairs.number[k];
      slot_[i] = pairs.slot[k];
      exit[i] = RoundedUp(decision.high[k] + kDoublePad);
    }
  }

  void Finish(const KernelJob& job, std::size_t first, const FrustumRays& rays) {
    Solver solver(job, rays);
    for (std::uint32_t i = 0; i < kRays; ++i) {
      if (found[i] == kNoPrimitive || (Base::alone >> i & 1u) != 0) continue;
      RoundedRay ray = origin_;
      for (int k = 0; k < 3; ++k) ray.direction[static_cast<int>(rays.axis[k])] = direction_[k][i];
      const LeafBlock& block = job.tree->blocks[slot_[i] / LeafBlock::kWidth];
      const auto lane = static_cast<unsigned>(slot_[i] % LeafBlock::kWidth);
      solver.Add(ray, i, found[i], {&block, lane});
    }
    solver.Flush();
    Base::LeaveAlone(0, solver.unknown);
    for (std::size_t four = 0; four < kRays / 4; ++four) {
      const std::size_t i = rays.order->place_of_four[four];
      StoreHits(job, first, *rays.order, four, Base::CallerT(rays, i, Load4(solver.t + i)),
                Load4(solver.u + i), Load4(solver.v + i), found);
    }
  }

 private:
  /// Computes t (local), u and v of the hits at places.
  struct Solver {
    const KernelJob& job;
    const FrustumRays& rays;
    alignas(64) double t[kRays] = {}, u[kRays] = {}, v[kRays] = {};
    std::uint64_t unknown = 0;  // places whose hits need more digits

    Solver(const KernelJob& its_job, const FrustumRays& its_rays) : job(its_job), rays(its_rays) {}

    KDRAY_INLINE void Add(const RoundedRay& ray, std::uint32_t at_place, PrimitiveId id,
                          BlockLane at) {
      hits_.SetRay(size_, ray);
      for (int c = 0; c < 3; ++c) hits_.SetCorner(size_, c, CornerOf<Stored>(job, id, at, c));
      place_[size_] = at_place;
      if (++size_ == kHitLanes) Flush();
    }
    void Flush() {
      alignas(64) double its_t[kHitLanes], its_u[kHitLanes], its_v[kHitLanes];
      const unsigned known = size_ != 0 ? SolveTogether(hits_, its_t, its_u, its_v) : 0;
      for (unsigned k = 0; k < size_; ++k) {
        const std::uint32_t i = place_[k];
        t[i] = its_t[k];
        u[i] = its_u[k];
        v[i] = its_v[k];
        const bool is_known = (known >> k & 1u) != 0 && IsRoundedOnce(rays.CallerT(its_t[k], i));
        unknown |= std::uint64_t{is_known ? 0u : 1u} << i;
      }
      size_ = 0;
    }

   private:
    ExactHits hits_ = {};
    std::uint32_t place_[kHitLanes];
    unsigned size_ = 0;
  };

  RoundedRay origin_;  // without a direction
  // By place; bounds of the s of the closest hit so far, and its slot.
  alignas(64) double low_[kRays], high_[kRays];
  alignas(64) std::uint32_t slot_[kRays];
  alignas(64) double direction_[3][kRays], inverse_[kRays], product_error_[kRays];
};

}  // namespace kdray::core::KDRAY_ISA
KDRAY_END_ISA();
