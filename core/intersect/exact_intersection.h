// SPDX-License-Identifier: Apache-2.0
// The triangle intersection of the precision `exact`: hits, and the order of t, are those of the
// real numbers that the caller gave.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>

#include "core/geometry/hit.h"
#include "core/geometry/local_ray.h"
#include "core/geometry/vec3.h"
#include "core/intersect/rounded_ray.h"

namespace kdray::core {

/// Decides on the input as given: mesh vertices as the parsed doubles (the mesh frame represents
/// them exactly), rays as the doubles of the request. Triangles are closed sets. Each decision is
/// made in double with an error bound; if the bound does not decide, in double-double
/// (core/intersect/rounded_ray.h); and last exactly, with integers (core/geometry/dyadic.h).
/// Nothing is allocated.
///
/// Properties: 1. Test() is true exactly when the ray's line meets the closed triangle and does not
/// lie in its plane. 2. IsCloser() compares the exact t; at equal t the smaller id is closer. 3.
/// Finish() answers the exact t rounded to the nearest double, and the largest finite one where
/// that is infinite; IsInInterval() compares this answer with the caller's interval. 4. u and v are
/// the exact weights, rounded once: to the nearest double, and below 2^-8 to the nearest multiple
/// of 2^-60. 5. Everything above depends on the ray and the triangles alone. Sources: Shewchuk,
/// "Adaptive Precision Floating-Point Arithmetic and Fast Robust Geometric Predicates", 1997 (the
/// filter of orient3d); Joldes et al. 2017 (the middle stage).
class ExactIntersection {
 public:
  using Number = double;
  using Corners = std::array<Vec3d, 3>;
  /// Work (CancelPoll) of a test: most take less, those that need integers more.
  static constexpr std::uint64_t kWork = 2048;

  /// A hit with the data for later comparisons.
  struct Hit {
    double low = 0,
           high = 0;                ///< bounds of the exact local parameter of LocalRay
    int side = 0;                   ///< common sign of the nonzero edge volumes
    std::array<bool, 3> on_edge{};  ///< volumes that are 0: the ray meets edge bc, ca, ab
  };

  /// Only for rays of MakeRay.
  explicit ExactIntersection(const LocalRay& ray);
  static std::optional<LocalRay> MakeRay(const Ray& ray, const MeshFrame& frame) {
    return MakeExactLocalRay(ray, frame);
  }

  double pad() const { return kDoublePad; }

  bool Test(const Vec3d& a, const Vec3d& b, const Vec3d& c, Hit* hit) const;

  /// Whether a hit is still one when the ray is moved by (e, e^2, e^3) for an infinitely small e >
  /// 0. A moved ray meets no edge and no corner, so of the triangles around one that the given ray
  /// meets, each crossing belongs to exactly one; where the ray only touches, to none or to two.
  /// (Triangles along the ray are not hit before or after.) The arguments are those of the Test()
  /// that was true. Source: Edelsbrunner and Muecke, "Simulation of Simplicity", ACM Transactions
  /// on Graphics 9(1), 1990; moving the ray alone is enough here, and keeps equal corners of
  /// different triangles equal.
  bool OwnsCrossing(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Hit& hit) const;

  template <class CornersOf>
  bool IsCloser(const Hit& hit, PrimitiveId id, const Hit& best, PrimitiveId best_id,
                const CornersOf& corners) const {
    if (hit.high < best.low) return true;
    if (hit.low > best.high) return false;
    const int order = CompareInDoubt(hit, corners(id), best, corners(best_id));
    return order < 0 || (order == 0 && id < best_id);
  }
  template <class CornersOf>
  bool IsInInterval(const Hit& hit, PrimitiveId id, const CornersOf& corners) const {
    if (hit.low > t_min_.high && hit.high < t_max_.low) return true;
    if (hit.high < t_min_.low || hit.low > t_max_.high) return false;
    const double t = FindT(corners(id));
    return t >= ray_.t_min && t <= ray_.t_max;
  }
  /// The local parameter beyond which no triangle is closer than a hit.
  double Limit(const Hit& hit) const { return hit.high + kDoublePad; }
  template <class CornersOf>
  core::Hit Finish(const Hit&, PrimitiveId id, const CornersOf& corners) const {
    return Answer(id, corners(id));
  }

 private:
  /// A signed volume: its exact sign, a value of that sign, and a bound on the value's error.
  struct Volume {
    int sign;
    double value, error;
  };
  /// The volume direction . ((p - origin) x (q - origin)), whose sign is the side on which the ray
  /// passes the edge p q.
  Volume EdgeVolume(const RoundedRay::Relative& p, const RoundedRay::Relative& q,
                    const Vec3d& p_exact, const Vec3d& q_exact) const;
  Volume EdgeVolumeInDoubt(const RoundedRay::Relative& p, const RoundedRay::Relative& q,
                           const Vec3d& p_exact, const Vec3d& q_exact) const;
  /// True only if that volume is 0 component by component: a factor of the direction is 0, or two
  /// products of exact differences are equal. This is the case of an axis-parallel ray that meets
  /// an edge.
  bool CancelsOut(const RoundedRay::Relative& p, const RoundedRay::Relative& q,
                  const Vec3d& p_exact, const Vec3d& q_exact) const;
  /// The sign of that volume for the moved ray of OwnsCrossing, if the volume is 0; 0 if the edge
  /// is parallel to the ray.
  int MovedSign(const Vec3d& p, const Vec3d& q) const;

  /// Compares the exact t of two hits: -1, 0, 1.
  int CompareInDoubt(const Hit& hit, const Corners& corners, const Hit& other,
                     const Corners& other_corners) const;
  /// The t to answer, from s in double-double if its bound allows, else exactly.
  double RoundT(const BoundedNumber& s, const Corners& corners) const;
  double FindT(const Corners& corners) const;
  core::Hit Answer(PrimitiveId id, const Corners& corners) const;

  const LocalRay& ray_;
  RoundedRay rounded_;
  RoundedRay::Bound t_min_, t_max_;
  std::array<bool, 3> is_parallel_;    // to the plane across the axis, as given
  std::array<bool, 3> is_axis_exact_;  // the rounded ray's origin is the given
                                       // one's, moved or not
};

}  // namespace kdray::core
