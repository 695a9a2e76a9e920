// SPDX-License-Identifier: Apache-2.0
// The distance of a point and a triangle in double: the arithmetic that decides in the precision
// `double`, and a filter with a proven bound in `exact`.
//
// Always inlined: in a caller compiled for fused multiply-add, std::fma becomes one instruction. It
// is exactly rounded everywhere, so all callers get the same bits.
#pragma once

#include <cmath>
#include <cstdint>

#include "core/geometry/double_double.h"
#include "core/geometry/vec3.h"

namespace kdray::core {

/// The part of a triangle that a point is closest to: a corner, the inside of an edge, or the face.
enum class TrianglePart : std::uint8_t {
  kCornerA,
  kCornerB,
  kCornerC,
  kEdgeAb,
  kEdgeBc,
  kEdgeCa,
  kFace
};

/// Bound of |sqrt(SquaredDistance) - distance| in local units, where `size` is the point's largest
/// |component|: kDistanceError * (size + 2). The corners lie in [-1, 1]^3.
///
/// Rounded edges and a rounded point make another triangle and another point, each within 4 units
/// (2^-53) of the lengths. The cross products are differences of products that are accurate to two
/// units of each component, so a needle's normal is as good as any other's. The sides are dot
/// products of such vectors: an error takes a point for one on the other side of an edge only
/// within 16 units of the edge, where the distances to edge and face differ by less than that. The
/// feet on edges are off by 8 units of the lengths along the edge. Every length is below
/// sqrt(3) (size + 1), and all of it together below 2^7 units of it.
inline constexpr double kDistanceError = 0x1p-45;

namespace point_triangle {

/// a * b - c * d to within two units in the last place (Kahan).
[[gnu::always_inline]] inline double ProductDifference(double a, double b, double c, double d) {
  const DoubleDouble ab = TwoProduct(a, b), cd = TwoProduct(c, d);
  return (ab.high - cd.high) + (ab.low - cd.low);
}
[[gnu::always_inline]] inline Vec3d AccurateCross(const Vec3d& a, const Vec3d& b) {
  return {ProductDifference(a.y, b.z, a.z, b.y), ProductDifference(a.z, b.x, a.x, b.z),
          ProductDifference(a.x, b.y, a.y, b.x)};
}
[[gnu::always_inline]] inline Vec3d Subtract(const Vec3d& a, const Vec3d& b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}
[[gnu::always_inline]] inline double DotOf(const Vec3d& a, const Vec3d& b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}

/// A face whose squared normal is below this is treated as its edges, from which none of its points
/// is farther than 2^-225.
inline constexpr double kLeastSquaredNormal = 0x1p-900;

/// The plane of a triangle: the normal (b - a) x (c - a), and the sides of the point, which are
/// the weights of the corners times the squared normal.
struct Face {
  Vec3d normal;
  double squared_normal;
  double side_a, side_b, side_c;
  double height;  ///< normal . (p - a)

  [[gnu::always_inline]] bool IsBelow() const {
    return side_a >= 0 && side_b >= 0 && side_c >= 0 && squared_normal >= kLeastSquaredNormal;
  }
};
[[gnu::always_inline]] inline Face FaceOf(const Vec3d& p, const Vec3d& a, const Vec3d& b,
                                          const Vec3d& c) {
  const Vec3d ab = Subtract(b, a), ac = Subtract(c, a), bc = Subtract(c, b);
  const Vec3d ap = Subtract(p, a), bp = Subtract(p, b);
  const Vec3d normal = AccurateCross(ab, ac);
  return {normal,
          DotOf(normal, normal),
          DotOf(normal, AccurateCross(bc, bp)),
          DotOf(normal, AccurateCross(ap, ac)),
          DotOf(normal, AccurateCross(ab, ap)),
          DotOf(normal, ap)};
}

/// The point of an edge that is closest to p. The edge's ends are ordered by their coordinates, so
/// triangles that share it get the same bits.
struct EdgeFoot {
  double square;  ///< of the distance
  double t;       ///< 0 at the first end, 1 at the second
  bool swapped;   ///< the first end is the caller's second
};
[[gnu::always_inline]] inline EdgeFoot FootOnEdge(const Vec3d& p, const Vec3d& a, const Vec3d& b) {
  const bool swapped = a.x > b.x || (a.x == b.x && (a.y > b.y || (a.y == b.y && a.z > b.z)));
  const Vec3d from = swapped ? b : a;
  const Vec3d to = swapped ? a : b;
  const Vec3d along = Subtract(to, from), at = Subtract(p, from), back = Subtract(p, to);
  const double t = DotOf(at, along) / DotOf(along, along);
  if (!(t > 0)) return {DotOf(at, at), 0, swapped};  // also for an edge whose square vanishes
  if (t >= 1) return {DotOf(back, back), 1, swapped};
  const Vec3d across = {at.x - t * along.x, at.y - t * along.y, at.z - t * along.z};
  return {DotOf(across, across), t, swapped};
}

}  // namespace point_triangle

/// The squared distance of p and the closed triangle. Depends on nothing but its arguments.
[[gnu::always_inline]] inline double SquaredDistance(const Vec3d& p, const Vec3d& a, const Vec3d& b,
                                                     const Vec3d& c) {
  const point_triangle::Face face = point_triangle::FaceOf(p, a, b, c);
  if (face.IsBelow()) return face.height * face.height / face.squared_normal;
  const double ab = point_triangle::FootOnEdge(p, a, b).square;
  const double bc = point_triangle::FootOnEdge(p, b, c).square;
  const double ca = point_triangle::FootOnEdge(p, c, a).square;
  const double least = bc < ab ? bc : ab;
  return ca < least ? ca : least;
}

/// The closest point of a triangle.
struct TriangleFoot {
  double square = 0;    ///< that of SquaredDistance, bit for bit
  Vec3d point;          ///< local
  double u = 0, v = 0;  ///< weights of the second and third corner, in [0, 1], with u + v <= 1
};
TriangleFoot FootOnTriangle(const Vec3d& p, const Vec3d& a, const Vec3d& b, const Vec3d& c);

}  // namespace kdray::core
