// The leaf test of the precision `exact`: hits, and the order of t, are those of the real numbers
// that the caller gave.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>

#include "core/geometry/hit.h"
#include "core/geometry/local_ray.h"
#include "core/geometry/vec3.h"
#include "core/trace/double_double.h"
#include "core/trace/product.h"

namespace kdray::core {

/// What ExactTest does in rounded arithmetic, with bounds on the errors. Inlined by force: where
/// the caller is compiled for fused multiply-add, it becomes one instruction.
struct RoundedRay {
  Vec3d direction;             ///< of LocalRay
  Vec3d origin;                ///< the origin as given, not moved along the ray; local, rounded
  Vec3d origin_low;            ///< what rounding took away
  double origin_rounding = 0;  ///< bound on |origin_low|; infinite where is_trusted is false
  /// False for rays so far from the mesh's scale that scaling them underflows or overflows.
  bool is_trusted = true;

  /// A triangle corner relative to the origin, rounded.
  struct Relative {
    Vec3d at;
    double size;  ///< largest |component|
  };
  struct Volume {
    double value;
    double error;  ///< bound; infinite where is_trusted is false
  };

  /// An edge's volume in double is off by no more than kProducts * (the sum of the sizes of its
  /// products) + kOrigin * origin_rounding * (the sum of the two corners' sizes) + kUnderflow.
  /// Shewchuk's bound for a determinant whose rows are rounded differences:
  static constexpr double kProducts = (7 + 56 * 0x1p-53) * 0x1p-53;
  /// What the origin's own rounding can add: six products of a direction below 2, one corner and
  /// the other's error.
  static constexpr double kOrigin = 16;
  static constexpr double kUnderflow = 0x1p-1000;
  /// FindT: a dozen operations of relative error 2^-102 on terms of the sizes it adds up; how much
  /// of that it takes; and the numerators and denominators below which something may underflow.
  static constexpr double kStepOfT = 0x1p-97;
  static constexpr double kMostDoubtOfT = 0x1p-56;
  static constexpr double kLeastOfT = 0x1p-900;

  RoundedRay() = default;
  explicit RoundedRay(const LocalRay& ray);

  Relative RelativeTo(const Vec3d& corner) const {
    const Vec3d at = corner - origin;
    return {at, MaxAbs(at)};
  }
  /// direction . ((p - origin) x (q - origin)): on which side the ray passes the edge p q.
  Volume EdgeVolume(const Relative& p, const Relative& q) const;
  /// t of the ray and a triangle's plane, to within 1 ulp; false when that takes more digits.
  bool FindT(const Vec3d& a, const Vec3d& b, const Vec3d& c, double* t) const;
  /// The weights of the second and third corner from the volumes opposite all three.
  static void FindWeights(double a, double b, double c, double* u, double* v) {
    const double inverse_sum = 1.0 / SymmetricSum(a, b, c);
    *u = b * inverse_sum + 0.0;  // -0 becomes 0
    *v = c * inverse_sum + 0.0;
  }
};

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
  /// What a test counts as (CancelPoll): most take less, those that come to integers more.
  static constexpr std::uint64_t kWork = 2048;

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
  double CallerT(const Hit& hit) const { return ToCallerT(hit.t, ray_.exponent); }
  double Slack() const { return pad() + std::fabs(ray_.shift) * 0x1p-50; }

 private:
  /// A signed volume: its exact sign, and a value of that sign.
  struct Volume {
    int sign;
    double value;
  };
  /// Sign of direction . ((p - origin) x (q - origin)): on which side the ray passes the edge p q.
  Volume EdgeVolume(const RoundedRay::Relative& p, const RoundedRay::Relative& q,
                    const Vec3d& p_exact, const Vec3d& q_exact) const;
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
  RoundedRay rounded_;
  double low_, high_;  // the caller's interval in local lengths
};

// ---- Implementation ----

inline RoundedRay::RoundedRay(const LocalRay& ray) : direction(ray.direction) {
  const Ray& given = *ray.given;
  const MeshFrame& frame = *ray.frame;
  const int scale = ray.exponent - frame.exponent;
  for (int axis = 0; axis < 3; ++axis) {
    const DoubleDouble moved = TwoDifference(given.origin[axis], frame.origin[axis]);
    origin[axis] = ScaleByPowerOfTwo(moved.high, -frame.exponent);
    origin_low[axis] = ScaleByPowerOfTwo(moved.low, -frame.exponent);
    if (ScaleByPowerOfTwo(origin[axis], frame.exponent) != moved.high ||
        ScaleByPowerOfTwo(origin_low[axis], frame.exponent) != moved.low ||
        ScaleByPowerOfTwo(direction[axis], -scale) != given.direction[axis]) {
      is_trusted = false;
    }
    origin_rounding = std::max(origin_rounding, std::fabs(origin_low[axis]));
  }
  if (!is_trusted) origin_rounding = std::numeric_limits<double>::infinity();
}

[[gnu::always_inline]] inline auto RoundedRay::EdgeVolume(const Relative& p,
                                                          const Relative& q) const -> Volume {
  const Vec3d& d = direction;
  const double yz = p.at.y * q.at.z, zy = p.at.z * q.at.y;
  const double zx = p.at.z * q.at.x, xz = p.at.x * q.at.z;
  const double xy = p.at.x * q.at.y, yx = p.at.y * q.at.x;
  const double value = d.x * (yz - zy) + d.y * (zx - xz) + d.z * (xy - yx);
  const double permanent = std::fabs(d.x) * (std::fabs(yz) + std::fabs(zy)) +
                           std::fabs(d.y) * (std::fabs(zx) + std::fabs(xz)) +
                           std::fabs(d.z) * (std::fabs(xy) + std::fabs(yx));
  return {value,
          kProducts * permanent + kOrigin * origin_rounding * (p.size + q.size) + kUnderflow};
}

[[gnu::always_inline]] inline bool RoundedRay::FindT(const Vec3d& a, const Vec3d& b, const Vec3d& c,
                                                     double* t) const {
  if (!is_trusted) return false;
  DoubleDouble numerator, denominator;
  double numerator_size = 0, denominator_size = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const int i = axis == 2 ? 0 : axis + 1;
    const int j = i == 2 ? 0 : i + 1;
    const DoubleDouble bi = TwoDifference(b[i], a[i]), bj = TwoDifference(b[j], a[j]);
    const DoubleDouble ci = TwoDifference(c[i], a[i]), cj = TwoDifference(c[j], a[j]);
    const DoubleDouble left = bi * cj, right = bj * ci;
    const DoubleDouble normal = left - right;
    const double normal_size = std::fabs(left.high) + std::fabs(right.high);
    const DoubleDouble to_plane =
        TwoDifference(a[axis], origin[axis]) - DoubleDouble{origin_low[axis], 0};
    numerator = numerator + normal * to_plane;
    denominator = denominator + normal * DoubleDouble{direction[axis], 0};
    // The size of what was subtracted to get to_plane counts, not what was left.
    numerator_size += normal_size * (std::fabs(a[axis]) + std::fabs(origin[axis]));
    denominator_size += normal_size * std::fabs(direction[axis]);
  }
  const double doubt = kStepOfT * (numerator_size / std::fabs(numerator.high) +
                                   denominator_size / std::fabs(denominator.high));
  if (!(doubt < kMostDoubtOfT && std::fabs(numerator.high) > kLeastOfT &&
        std::fabs(denominator.high) > kLeastOfT)) {
    return false;
  }
  const DoubleDouble quotient = numerator / denominator;
  *t = quotient.high + quotient.low;
  return true;
}

}  // namespace kdray::core
