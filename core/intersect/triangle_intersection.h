// SPDX-License-Identifier: Apache-2.0
// The one test per precision that decides whether a ray hits a triangle, and where. Kernels only
// choose which triangles come here. A test reads nothing but the ray and the triangle, in a fixed
// order of operations, so its answer depends on nothing else. Compiled without contraction into
// fused operations (cmake/KdrayTarget.cmake).
#pragma once

#include <cmath>
#include <cstdint>
#include <optional>

#include "core/geometry/hit.h"
#include "core/geometry/local_ray.h"
#include "core/geometry/vec3.h"
#include "core/intersect/difference_of_products.h"

namespace kdray::core {

/// Where a test found the ray to hit. `s` is the local parameter of LocalRay.
struct TriangleHit {
  double s;
  double u, v;  ///< weights of the second and third corner
};

/// How the tests in rounded arithmetic order their hits and hold them against the caller's
/// interval. `corners(id)` gives a triangle's three corners, which only the exact test needs.
class RoundedOrder {
 public:
  /// What a test counts as (CancelPoll).
  static constexpr std::uint64_t kWork = 64;

  explicit RoundedOrder(const LocalRay& ray) : ray_(ray) {}
  /// The form of a ray that the test takes; nothing when it misses the mesh.
  static std::optional<LocalRay> MakeRay(const Ray& ray, const MeshFrame& frame) {
    return MakeLocalRay(ray, frame);
  }

  /// Orders by s + shift, which orders as t does but cannot overflow; at equality by id.
  template <class CornersOf>
  bool IsCloser(const TriangleHit& hit, PrimitiveId id, const TriangleHit& best,
                PrimitiveId best_id, const CornersOf&) const {
    return Closer(hit.s + ray_.shift, id, best.s + ray_.shift, best_id);
  }
  template <class CornersOf>
  bool IsInInterval(const TriangleHit& hit, PrimitiveId, const CornersOf&) const {
    const double t = CallerT(hit);
    return t >= ray_.t_min && t <= ray_.t_max;
  }
  /// For count and all, which in these precisions report every triangle that the test accepts.
  template <class T>
  bool OwnsCrossing(const Vec3<T>&, const Vec3<T>&, const Vec3<T>&, const TriangleHit&) const {
    return true;
  }
  double CallerT(const TriangleHit& hit) const { return ray_.ToCallerT(hit.s); }
  /// The local parameter beyond which nothing is closer than a hit. Different s can round to one t:
  /// a triangle that ties with the hit may begin a little later.
  double Limit(const TriangleHit& hit) const { return hit.s + std::fabs(ray_.shift) * 0x1p-50; }
  template <class CornersOf>
  core::Hit Finish(const TriangleHit& hit, PrimitiveId id, const CornersOf&) const {
    return {CallerT(hit), hit.u, hit.v, id};
  }

 protected:
  const LocalRay& ray() const { return ray_; }

 private:
  const LocalRay& ray_;
};

/// Barycentric weights of three corners, not normalised, all of one sign (0 counts as either), not
/// all 0.
struct CornerWeights {
  double a, b, c;
};

/// The watertight test of Woop, Benthin and Wald, "Watertight Ray/Triangle Intersection", JCGT
/// 2(1), 2013, in T = float or double, with edge signs that are exact for the projected corners (a
/// product that ties is decided exactly).
///
/// Properties, each with a test of its name in
/// tests/unit/core/intersect/triangle_intersection_test.cc:
///  1. Closed: a ray through an edge or corner that triangles share hits at least one of them.
///  2. Two-sided: reversing a triangle's corners changes nothing but which of u, v is which;
///  turning them changes no t.
///  3. Local: the accepted triangle has a point within kFloatPad (float) or kDoublePad (double) of
///  the ray at s.
///  4. A ray that lies in the triangle's plane misses. NaN corners miss.
///  5. s, u, v come from double arithmetic in both forms.
template <class T>
class WatertightIntersection : public RoundedOrder {
 public:
  using Number = T;
  using Hit = TriangleHit;
  static constexpr double kPad = sizeof(T) == sizeof(float) ? kFloatPad : kDoublePad;

  explicit WatertightIntersection(const LocalRay& ray);
  double pad() const { return kPad; }

  bool Test(const Vec3<T>& a, const Vec3<T>& b, const Vec3<T>& c, TriangleHit* hit) const;

 private:
  /// A corner as the ray sees it: the ray runs along the third axis through (0, 0).
  template <class U>
  struct Projected {
    U x, y;
  };
  Projected<T> Project(const Vec3<T>& corner) const;
  Projected<double> ProjectDouble(const Vec3<T>& corner) const;
  double Along(const Vec3<T>& corner) const;
  static bool WeightsOf(const Projected<double>& a, const Projected<double>& b,
                        const Projected<double>& c, CornerWeights* weights);

  int x_axis_, y_axis_, z_axis_;  // z: where the direction is largest
  Vec3<T> origin_;
  T shear_x_, shear_y_;
  Vec3d origin_double_;
  double shear_x_double_, shear_y_double_, inverse_z_;
};

/// Float Moeller-Trumbore ("Fast, Minimum Storage Ray/Triangle Intersection", JGT 2(1), 1997), then
/// a check that the point on the ray and the point on the triangle agree (property 3 above). Where
/// they do not, as on needles and at grazing angles, the double test decides: without that a
/// triangle could be "hit" far from where it is, and the answer would depend on which triangles a
/// kernel offers. It promises nothing at edges: neighbours may both miss.
class FastIntersection : public RoundedOrder {
 public:
  using Number = float;
  using Hit = TriangleHit;
  static constexpr double kPad = kFloatPad;

  explicit FastIntersection(const LocalRay& ray)
      : RoundedOrder(ray), origin_(ray.origin), direction_(ray.direction) {}
  double pad() const { return kPad; }
  /// How far apart the two points may be: half of kPad; the other half is for the rounding of the
  /// check itself.
  static constexpr float kTolerance = 0x1p-18f;

  bool Test(const Vec3f& a, const Vec3f& b, const Vec3f& c, TriangleHit* hit) const;

 private:
  Vec3f origin_, direction_;
};

// ---- Implementation ----

template <class T>
WatertightIntersection<T>::WatertightIntersection(const LocalRay& ray)
    : RoundedOrder(ray), origin_(ray.origin), origin_double_(ray.origin) {
  const Vec3d size{std::fabs(ray.direction.x), std::fabs(ray.direction.y),
                   std::fabs(ray.direction.z)};
  z_axis_ = size.x >= size.y ? (size.x >= size.z ? 0 : 2) : (size.y >= size.z ? 1 : 2);
  x_axis_ = z_axis_ == 2 ? 0 : z_axis_ + 1;
  y_axis_ = x_axis_ == 2 ? 0 : x_axis_ + 1;
  inverse_z_ = 1.0 / ray.direction[z_axis_];
  shear_x_double_ = ray.direction[x_axis_] / ray.direction[z_axis_];
  shear_y_double_ = ray.direction[y_axis_] / ray.direction[z_axis_];
  shear_x_ = static_cast<T>(shear_x_double_);
  shear_y_ = static_cast<T>(shear_y_double_);
}

template <class T>
auto WatertightIntersection<T>::Project(const Vec3<T>& corner) const -> Projected<T> {
  const T z = corner[z_axis_] - origin_[z_axis_];
  return {(corner[x_axis_] - origin_[x_axis_]) - shear_x_ * z,
          (corner[y_axis_] - origin_[y_axis_]) - shear_y_ * z};
}

template <class T>
auto WatertightIntersection<T>::ProjectDouble(const Vec3<T>& corner) const -> Projected<double> {
  const double z = static_cast<double>(corner[z_axis_]) - origin_double_[z_axis_];
  return {(static_cast<double>(corner[x_axis_]) - origin_double_[x_axis_]) - shear_x_double_ * z,
          (static_cast<double>(corner[y_axis_]) - origin_double_[y_axis_]) - shear_y_double_ * z};
}

template <class T>
double WatertightIntersection<T>::Along(const Vec3<T>& corner) const {
  return (static_cast<double>(corner[z_axis_]) - origin_double_[z_axis_]) * inverse_z_;
}

template <class T>
bool WatertightIntersection<T>::WeightsOf(const Projected<double>& a, const Projected<double>& b,
                                          const Projected<double>& c, CornerWeights* weights) {
  *weights = {DifferenceOfProducts(c.x, b.y, c.y, b.x), DifferenceOfProducts(a.x, c.y, a.y, c.x),
              DifferenceOfProducts(b.x, a.y, b.y, a.x)};
  const bool any_negative = weights->a < 0 || weights->b < 0 || weights->c < 0;
  const bool any_positive = weights->a > 0 || weights->b > 0 || weights->c > 0;
  return any_negative != any_positive;
}

template <class T>
bool WatertightIntersection<T>::Test(const Vec3<T>& a, const Vec3<T>& b, const Vec3<T>& c,
                                     TriangleHit* hit) const {
  const Projected<T> pa = Project(a);
  const Projected<T> pb = Project(b);
  const Projected<T> pc = Project(c);

  // Signed areas opposite each corner. Rounding cannot turn their sign, only make two different
  // products equal.
  const T wa = pc.x * pb.y - pc.y * pb.x;
  const T wb = pa.x * pc.y - pa.y * pc.x;
  const T wc = pb.x * pa.y - pb.y * pa.x;
  if ((wa < 0 || wb < 0 || wc < 0) && (wa > 0 || wb > 0 || wc > 0)) return false;
  if (wa == 0 || wb == 0 || wc == 0) {
    const int sa = SignOfDifference(pc.x, pb.y, pc.y, pb.x);
    const int sb = SignOfDifference(pa.x, pc.y, pa.y, pc.x);
    const int sc = SignOfDifference(pb.x, pa.y, pb.y, pa.x);
    const bool any_negative = sa < 0 || sb < 0 || sc < 0;
    const bool any_positive = sa > 0 || sb > 0 || sc > 0;
    if (any_negative == any_positive)
      return false;  // outside, or all 0: the triangle is seen edge-on
  } else if (std::isnan(wa) || std::isnan(wb) || std::isnan(wc)) {
    return false;
  }

  // Accepted. The weights of the corners as the unrounded ray sees them, where it agrees that it is
  // inside; else those of the rounded projection, which are exact for it: either way the weighted
  // point is within kPad of the ray.
  CornerWeights w;
  if (!WeightsOf(ProjectDouble(a), ProjectDouble(b), ProjectDouble(c), &w)) {
    const auto widen = [](const Projected<T>& p) {
      return Projected<double>{static_cast<double>(p.x), static_cast<double>(p.y)};
    };
    if (!WeightsOf(widen(pa), widen(pb), widen(pc), &w)) return false;
  }
  const double inverse_sum = 1.0 / SymmetricSum(w.a, w.b, w.c);
  hit->s = SymmetricSum(w.a * Along(a), w.b * Along(b), w.c * Along(c)) * inverse_sum;
  hit->u = w.b * inverse_sum + 0.0;  // -0 becomes 0
  hit->v = w.c * inverse_sum + 0.0;
  return std::isfinite(hit->s);
}

inline bool FastIntersection::Test(const Vec3f& a, const Vec3f& b, const Vec3f& c,
                                   TriangleHit* hit) const {
  const Vec3f edge_b = b - a;
  const Vec3f edge_c = c - a;
  const Vec3f p = Cross(direction_, edge_c);
  const float determinant = Dot(edge_b, p);
  if (determinant == 0) return false;
  const float inverse = 1.0f / determinant;
  const Vec3f from_a = origin_ - a;
  const float u = Dot(from_a, p) * inverse;
  if (!(u >= 0 && u <= 1)) return false;
  const Vec3f q = Cross(from_a, edge_b);
  const float v = Dot(direction_, q) * inverse;
  if (!(v >= 0 && u + v <= 1)) return false;
  const float s = Dot(edge_c, q) * inverse;

  const Vec3f gap = (from_a + direction_ * s) - (edge_b * u + edge_c * v);
  if (!(MaxAbs(gap) <= kTolerance)) {
    return WatertightIntersection<double>(ray()).Test(Vec3d(a), Vec3d(b), Vec3d(c), hit);
  }
  *hit = {static_cast<double>(s), static_cast<double>(u) + 0.0, static_cast<double>(v) + 0.0};
  return true;
}

}  // namespace kdray::core
