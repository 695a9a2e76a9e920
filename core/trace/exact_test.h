// The leaf test of the precision `exact`: hits, and the order of t, are those of the real numbers
// that the caller gave.
#pragma once

#include <array>
#include <cmath>

#include "core/geometry/hit.h"
#include "core/geometry/local_ray.h"
#include "core/geometry/vec3.h"

namespace kdray::core {

/// Decides on the input as given: mesh vertices as the doubles that were parsed (the mesh frame
/// holds them exactly), rays as the doubles of the request. Triangles are closed sets. Each
/// decision is made in double with a bound on its error; where the bound does not settle it,
/// exactly, with integers (core/trace/dyadic.h).
///
/// Properties:
///  1. Test() is true exactly when the ray's line meets the closed triangle and does not lie in its
///  plane.
///  2. IsCloser() and IsInInterval() compare the exact t; at equal t the smaller id is closer.
///  3. CallerT() is the exact t rounded once, to within 1 unit in the last place (results below
///  2^-1022: twice).
///  4. Everything above depends on the ray and the triangles alone.
/// Sources: Shewchuk, "Adaptive Precision Floating-Point Arithmetic and Fast Robust Geometric
/// Predicates", 1997 (the filter of orient3d); Joldes et al. 2017 (the middle stage).
class ExactTest {
 public:
  using Number = double;
  using Corners = std::array<Vec3d, 3>;

  /// A hit with what later comparisons need.
  struct Hit {
    double s = 0;  ///< local parameter of LocalRay, rounded: for culling
    double u = 0, v = 0;
    double t = 0;  ///< in lengths of LocalRay::direction from the origin as given, to within 1 ulp
    int side = 0;  ///< common sign of the edges' volumes, where they are not 0
    std::array<bool, 3> on_edge{};  ///< volumes that are 0: the ray meets edge bc, ca, ab
  };

  explicit ExactTest(const LocalRay& ray);

  /// The culls work on a rounded ray: wider for an origin that was moved from far away.
  double pad() const { return kDoublePad + std::fabs(ray_.shift) * 0x1p-48; }

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
    if (!MayTie(hit.t, best.t)) return hit.t < best.t;
    const int order = CompareExactly(corners(id), corners(best_id));
    return order < 0 || (order == 0 && id < best_id);
  }
  template <class CornersOf>
  bool IsInInterval(const Hit& hit, PrimitiveId id, const CornersOf& corners) const {
    return IsBound(hit.t, low_, id, corners) >= 0 && IsBound(hit.t, high_, id, corners) <= 0;
  }
  double CallerT(const Hit& hit) const { return ScaleByPowerOfTwo(hit.t, ray_.exponent); }
  double Slack() const { return pad() + std::fabs(ray_.shift) * 0x1p-50; }

 private:
  /// A signed volume: its exact sign, and a value of that sign.
  struct Volume {
    int sign;
    double value;
  };
  /// A triangle corner relative to the ray's origin, rounded.
  struct Relative {
    Vec3d at;
    double size;  ///< largest |component|
  };

  Relative RelativeTo(const Vec3d& corner) const;
  /// Sign of direction . ((p - origin) x (q - origin)): on which side the ray passes the edge p q.
  Volume EdgeVolume(const Relative& p, const Relative& q, const Vec3d& p_exact,
                    const Vec3d& q_exact) const;
  /// Sign of that volume, when it is 0, for the moved ray of OwnsCrossing; 0 when the edge is
  /// parallel to the ray.
  int MovedSign(const Vec3d& p, const Vec3d& q) const;
  double ExactOrRoundedT(const Vec3d& a, const Vec3d& b, const Vec3d& c) const;

  /// Two rounded t, each within 1 ulp: whether their order is in doubt.
  static bool MayTie(double t, double other) {
    return std::fabs(t - other) <= 0x1p-50 * std::max(std::fabs(t), std::fabs(other));
  }
  /// -1, 0, 1: how the exact t compares with a bound of the caller's interval, given in local
  /// lengths.
  template <class CornersOf>
  int IsBound(double t, double bound, PrimitiveId id, const CornersOf& corners) const {
    if (std::isinf(bound)) return bound > 0 ? -1 : 1;
    if (!MayTie(t, bound)) return t < bound ? -1 : 1;
    return CompareExactly(corners(id), bound);
  }
  int CompareExactly(const Corners& a, const Corners& b) const;
  int CompareExactly(const Corners& triangle, double bound) const;

  const LocalRay& ray_;
  Vec3d origin_;            // as given, local, rounded
  Vec3d origin_low_;        // what rounding took away
  double origin_rounding_;  // bound on |origin_low_|, 0 when origin_ is exact
  bool trust_rounded_;  // false for rays so far from the mesh's scale that scaling them underflows
  double low_, high_;   // the caller's interval in local lengths
};

}  // namespace kdray::core
