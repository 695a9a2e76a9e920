#include "tests/support/rationals.h"

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

bool IsInInterval(const Ray& ray, const mpq_class& t) {
  return (std::isinf(ray.t_min) ? ray.t_min < 0 : mpq_class(ray.t_min) <= t) &&
         (std::isinf(ray.t_max) ? ray.t_max > 0 : t <= mpq_class(ray.t_max));
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

bool IsWithinOneUlp(double rounded, const mpq_class& exact) {
  const double below = std::nextafter(rounded, -std::numeric_limits<double>::infinity());
  const double above = std::nextafter(rounded, std::numeric_limits<double>::infinity());
  return mpq_class(below) <= exact && exact <= mpq_class(above);
}

}  // namespace kdray::test
