// SPDX-License-Identifier: Apache-2.0
#include "tests/support/rationals.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

namespace kdray::test {

using core::MeshData;
using core::PrimitiveId;
using core::Ray;
using core::Vec3d;

namespace {

struct Q3 {
  mpq_class x, y, z;
};
Q3 ToQ(const Vec3d& v) { return {mpq_class(v.x), mpq_class(v.y), mpq_class(v.z)}; }
Q3 operator+(const Q3& a, const Q3& b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
Q3 operator-(const Q3& a, const Q3& b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
mpq_class Dot(const Q3& a, const Q3& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
Q3 Cross(const Q3& a, const Q3& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

struct QTriangle {
  Q3 a, b, c, normal;
};
QTriangle ToQ(const TriangleCorners& corners) {
  const Q3 a = ToQ(corners[0]), b = ToQ(corners[1]), c = ToQ(corners[2]);
  return {a, b, c, Cross(b - a, c - a)};
}

/// -1, 0, 1 for outside, on the boundary, inside: where the line from `origin` at parameter t is.
int SideOf(const QTriangle& triangle, const Q3& origin, const Q3& direction, const mpq_class& t) {
  const Q3 p{origin.x + t * direction.x, origin.y + t * direction.y, origin.z + t * direction.z};
  int side = 1;
  for (const auto& [from, to] : {std::pair{&triangle.a, &triangle.b},
                                 {&triangle.b, &triangle.c},
                                 {&triangle.c, &triangle.a}}) {
    side = std::min(side, sgn(Dot(triangle.normal, Cross(*to - *from, p - *from))));
  }
  return side;
}

}  // namespace

TriangleCorners CornersOf(const MeshData& data, PrimitiveId id) {
  const core::TriangleIndices& t = data.triangles[id];
  return {data.vertices[t[0]], data.vertices[t[1]], data.vertices[t[2]]};
}

std::optional<mpq_class> RationalHit(const Ray& ray, const TriangleCorners& corners) {
  const QTriangle triangle = ToQ(corners);
  const Q3 origin = ToQ(ray.origin), direction = ToQ(ray.direction);
  const mpq_class along = Dot(triangle.normal, direction);
  if (along == 0) return std::nullopt;
  mpq_class t = Dot(triangle.normal, triangle.a - origin) / along;
  if (SideOf(triangle, origin, direction, t) < 0) return std::nullopt;
  return t;
}

double RoundedToNearest(const mpq_class& t) {
  if (t == 0) return 0;
  const mpq_class size = abs(t);
  // 2^exponent <= size < 2^(exponent + 1), give or take one.
  long exponent = static_cast<long>(mpz_sizeinbase(size.get_num().get_mpz_t(), 2)) -
                  static_cast<long>(mpz_sizeinbase(size.get_den().get_mpz_t(), 2));
  const auto power = [](long k) {
    mpq_class q(1);
    if (k >= 0) {
      mpq_mul_2exp(q.get_mpq_t(), q.get_mpq_t(), static_cast<unsigned long>(k));
    } else {
      mpq_div_2exp(q.get_mpq_t(), q.get_mpq_t(), static_cast<unsigned long>(-k));
    }
    return q;
  };
  while (power(exponent) > size) --exponent;
  while (power(exponent + 1) <= size) ++exponent;
  const long unit = std::max(exponent - 52, -1074L);  // the last place, a power of two
  const mpq_class scaled = size / power(unit);
  mpz_class whole = scaled.get_num() / scaled.get_den();
  const int half = cmp(scaled - whole, mpq_class(1, 2));
  if (half > 0 || (half == 0 && mpz_odd_p(whole.get_mpz_t()))) ++whole;
  const double rounded = std::min(std::ldexp(whole.get_d(), static_cast<int>(unit)),
                                  std::numeric_limits<double>::max());
  return (t < 0 ? -rounded : rounded) + 0.0;
}

bool IsInInterval(const Ray& ray, const mpq_class& t) {
  const double answered = RoundedToNearest(t);
  return ray.t_min <= answered && answered <= ray.t_max;
}

RationalWeights WeightsOf(const Ray& ray, const TriangleCorners& corners) {
  const QTriangle triangle = ToQ(corners);
  const Q3 origin = ToQ(ray.origin), d = ToQ(ray.direction);
  const mpq_class t = Dot(triangle.normal, triangle.a - origin) / Dot(triangle.normal, d);
  const Q3 p{origin.x + t * d.x, origin.y + t * d.y, origin.z + t * d.z};
  const mpq_class area = Dot(triangle.normal, triangle.normal);
  return {Dot(triangle.normal, Cross(triangle.a - triangle.c, p - triangle.c)) / area,
          Dot(triangle.normal, Cross(triangle.b - triangle.a, p - triangle.a)) / area};
}

RationalClosestHit RationalClosest(const MeshData& data, const Ray& ray) {
  RationalClosestHit best;
  for (PrimitiveId id = 0; id < data.triangles.size(); ++id) {
    const auto t = RationalHit(ray, CornersOf(data, id));
    if (!t || !IsInInterval(ray, *t)) continue;
    if (best.primitive_id == core::kNoPrimitive || *t < best.t) best = {id, *t};
  }
  return best;
}

std::size_t RationalCrossings(const MeshData& data, const Ray& ray, const mpq_class& e) {
  std::size_t crossings = 0;
  const Q3 origin = ToQ(ray.origin), direction = ToQ(ray.direction);
  const Q3 moved = origin + Q3{e, e * e, e * e * e};
  for (PrimitiveId id = 0; id < data.triangles.size(); ++id) {
    const QTriangle triangle = ToQ(CornersOf(data, id));
    const mpq_class along = Dot(triangle.normal, direction);
    if (along == 0) continue;
    const mpq_class moved_t = Dot(triangle.normal, triangle.a - moved) / along;
    const int side = SideOf(triangle, moved, direction, moved_t);
    if (side == 0) throw std::logic_error("the moved ray meets an edge");
    if (side < 0) continue;
    if (IsInInterval(ray, Dot(triangle.normal, triangle.a - origin) / along)) ++crossings;
  }
  return crossings;
}

mpq_class RationalSquaredDistance(const Vec3d& point, const TriangleCorners& corners) {
  const QTriangle triangle = ToQ(corners);
  const Q3 p = ToQ(point);
  const std::array<const Q3*, 3> at = {&triangle.a, &triangle.b, &triangle.c};
  mpq_class best = Dot(p - *at[0], p - *at[0]);
  for (std::size_t k = 0; k < 3; ++k) {
    const Q3 way = p - *at[k], edge = *at[(k + 1) % 3] - *at[k];
    best = std::min<mpq_class>(best, Dot(way, way));
    const mpq_class along = Dot(way, edge), length = Dot(edge, edge);
    if (along <= 0 || along >= length) continue;
    best = std::min<mpq_class>(best, Dot(way, way) - along * along / length);
  }
  const mpq_class area = Dot(triangle.normal, triangle.normal);
  if (area == 0) return best;
  // The line through the point along the normal meets the triangle.
  const mpq_class t = Dot(triangle.normal, triangle.a - p) / area;
  if (SideOf(triangle, p, triangle.normal, t) >= 0) best = std::min<mpq_class>(best, t * t * area);
  return best;
}

RationalClosestPoint RationalClosestTo(const MeshData& data, const Vec3d& point) {
  RationalClosestPoint best;
  for (PrimitiveId id = 0; id < data.triangles.size(); ++id) {
    const TriangleCorners corners = CornersOf(data, id);
    const QTriangle triangle = ToQ(corners);
    if (Dot(triangle.normal, triangle.normal) == 0) continue;
    const mpq_class square = RationalSquaredDistance(point, corners);
    if (best.primitive_id == core::kNoPrimitive || square < best.square) best = {id, square};
  }
  return best;
}

bool IsRoundedRoot(double root, const mpq_class& square) {
  if (square == 0) return root == 0;
  const mpq_class x(root);
  const mpq_class above(std::nextafter(root, std::numeric_limits<double>::infinity()));
  const mpq_class below(std::nextafter(root, 0.0));
  const mpq_class high = (x + above) / 2, low = (x + below) / 2;
  return low * low <= square && square <= high * high;
}

}  // namespace kdray::test
