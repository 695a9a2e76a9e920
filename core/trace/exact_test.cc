#include "core/trace/exact_test.h"

#include <algorithm>

#include "core/trace/dyadic.h"

namespace kdray::core {
namespace {

constexpr double kUnit = 0x1p-53;  // half an ulp of 1

// Exact parameters below are in lengths of the local direction unless it was rounded; the ratio t
// is then the same as long as one form is used throughout, so the exact side always uses the
// direction as given, scaled into the frame.
struct DyadicVec3 {
  Dyadic x, y, z;
};

DyadicVec3 operator-(const DyadicVec3& a, const DyadicVec3& b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}
Dyadic Dot(const DyadicVec3& a, const DyadicVec3& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
DyadicVec3 Cross(const DyadicVec3& a, const DyadicVec3& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
DyadicVec3 Exactly(const Vec3d& v) { return {Dyadic(v.x), Dyadic(v.y), Dyadic(v.z)}; }

DyadicVec3 ScaledBy(const DyadicVec3& v, int exponent) {
  return {v.x.TimesPowerOfTwo(exponent), v.y.TimesPowerOfTwo(exponent),
          v.z.TimesPowerOfTwo(exponent)};
}

DyadicVec3 ExactOrigin(const LocalRay& ray) {
  return ScaledBy(Exactly(ray.given->origin) - Exactly(ray.frame->origin), -ray.frame->exponent);
}

/// The local direction without rounding: local t counts its lengths.
DyadicVec3 ExactDirection(const LocalRay& ray) {
  return ScaledBy(Exactly(ray.given->direction), ray.exponent - ray.frame->exponent);
}

/// t = numerator / denominator of the ray against a triangle's plane.
struct ExactParameter {
  Dyadic numerator, denominator;
};

ExactParameter ParameterOf(const LocalRay& ray, const ExactTest::Corners& triangle) {
  const DyadicVec3 a = Exactly(triangle[0]);
  const DyadicVec3 normal = Cross(Exactly(triangle[1]) - a, Exactly(triangle[2]) - a);
  return {Dot(normal, a - ExactOrigin(ray)), Dot(normal, ExactDirection(ray))};
}

}  // namespace

ExactTest::ExactTest(const LocalRay& ray)
    : ray_(ray),
      rounded_(ray),
      low_(ScaleByPowerOfTwo(ray.given->t_min, -ray.exponent)),
      high_(ScaleByPowerOfTwo(ray.given->t_max, -ray.exponent)) {}

auto ExactTest::EdgeVolume(const RoundedRay::Relative& p, const RoundedRay::Relative& q,
                           const Vec3d& p_exact, const Vec3d& q_exact) const -> Volume {
  const auto [value, error] = rounded_.EdgeVolume(p, q);
  if (std::fabs(value) > error) return {value > 0 ? 1 : -1, value};

  const DyadicVec3 origin = ExactOrigin(ray_);
  const Dyadic exact =
      Dot(ExactDirection(ray_), Cross(Exactly(p_exact) - origin, Exactly(q_exact) - origin));
  return {exact.Sign(), Dyadic::Quotient(exact, Dyadic(1.0))};
}

double ExactTest::ExactOrRoundedT(const Vec3d& a, const Vec3d& b, const Vec3d& c) const {
  double t = 0;
  if (rounded_.FindT(a, b, c, &t)) return t;
  const ExactParameter exact = ParameterOf(ray_, {a, b, c});
  return Dyadic::Quotient(exact.numerator, exact.denominator);
}

bool ExactTest::Test(const Vec3d& a, const Vec3d& b, const Vec3d& c, Hit* hit) const {
  const RoundedRay::Relative ra = rounded_.RelativeTo(a), rb = rounded_.RelativeTo(b),
                             rc = rounded_.RelativeTo(c);
  const Volume wa = EdgeVolume(rb, rc, b, c);
  const Volume wb = EdgeVolume(rc, ra, c, a);
  if (wa.sign * wb.sign < 0) return false;
  const Volume wc = EdgeVolume(ra, rb, a, b);
  const bool any_negative = wa.sign < 0 || wb.sign < 0 || wc.sign < 0;
  const bool any_positive = wa.sign > 0 || wb.sign > 0 || wc.sign > 0;
  if (any_negative == any_positive) return false;  // outside, or all 0: the ray lies in the plane

  hit->t = ExactOrRoundedT(a, b, c);
  hit->s = hit->t - ray_.shift;
  RoundedRay::FindWeights(wa.value, wb.value, wc.value, &hit->u, &hit->v);
  hit->side = any_positive ? 1 : -1;
  hit->on_edge = {wa.sign == 0, wb.sign == 0, wc.sign == 0};
  return true;
}

bool ExactTest::OwnsCrossing(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Hit& hit) const {
  return (!hit.on_edge[0] || MovedSign(b, c) == hit.side) &&
         (!hit.on_edge[1] || MovedSign(c, a) == hit.side) &&
         (!hit.on_edge[2] || MovedSign(a, b) == hit.side);
}

// With the origin moved by m, the volume direction . ((p - origin) x (q - origin)) grows by
// m . ((p - q) x direction). For m = (e, e^2, e^3) the first component of the product that is not 0
// decides.
int ExactTest::MovedSign(const Vec3d& p, const Vec3d& q) const {
  const Vec3d edge = p - q;
  const Vec3d& d = ray_.direction;
  for (int axis = 0; axis < 3; ++axis) {
    const int i = axis == 2 ? 0 : axis + 1;
    const int j = i == 2 ? 0 : i + 1;
    const double left = edge[i] * d[j];
    const double right = edge[j] * d[i];
    const double value = left - right;
    // Three roundings on the way to each product and their difference; then underflow.
    const double bound = 4 * kUnit * (std::fabs(left) + std::fabs(right)) + 0x1p-1070;
    if (rounded_.is_trusted && std::fabs(value) > bound) return value > 0 ? 1 : -1;
    // A rounded difference is 0 only when the corners' coordinates are equal.
    if (rounded_.is_trusted && (edge[i] == 0 || d[j] == 0) && (edge[j] == 0 || d[i] == 0)) continue;
    const DyadicVec3 edge_exact = Exactly(p) - Exactly(q);
    const DyadicVec3 product = Cross(edge_exact, ExactDirection(ray_));
    const int sign = (axis == 0 ? product.x : axis == 1 ? product.y : product.z).Sign();
    if (sign != 0) return sign;
  }
  return 0;
}

int ExactTest::CompareExactly(const Corners& a, const Corners& b) const {
  const ExactParameter ta = ParameterOf(ray_, a);
  const ExactParameter tb = ParameterOf(ray_, b);
  const int difference = (ta.numerator * tb.denominator - tb.numerator * ta.denominator).Sign();
  return difference * ta.denominator.Sign() * tb.denominator.Sign();
}

int ExactTest::CompareExactly(const Corners& triangle, double bound) const {
  // The bound as given, not as scaled: that may have been rounded.
  const double given = bound == low_ ? ray_.given->t_min : ray_.given->t_max;
  const ExactParameter t = ParameterOf(ray_, triangle);
  const Dyadic limit = Dyadic(given).TimesPowerOfTwo(-ray_.exponent);
  return (t.numerator - limit * t.denominator).Sign() * t.denominator.Sign();
}

}  // namespace kdray::core
