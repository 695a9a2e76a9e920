// SPDX-License-Identifier: Apache-2.0
#include "core/intersect/exact_intersection.h"

#include <algorithm>

#include "core/geometry/dyadic.h"

namespace kdray::core {
namespace {

constexpr double kUnit = 0x1p-53;  // half an ulp of 1

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

/// The origin as given, in the mesh's frame.
DyadicVec3 ExactOrigin(const LocalRay& ray) {
  return ScaledBy(Exactly(ray.given->origin) - Exactly(ray.frame->origin), -ray.frame->exponent);
}

/// The direction as given, in the mesh's frame; so the exact t below is the caller's.
DyadicVec3 ExactDirection(const LocalRay& ray) {
  return ScaledBy(Exactly(ray.given->direction), -ray.frame->exponent);
}

/// t = numerator / denominator of the ray against a triangle's plane.
struct ExactParameter {
  Dyadic numerator, denominator;
};

ExactParameter ParameterOf(const LocalRay& ray, const ExactIntersection::Corners& triangle) {
  const DyadicVec3 a = Exactly(triangle[0]);
  const DyadicVec3 normal = Cross(Exactly(triangle[1]) - a, Exactly(triangle[2]) - a);
  return {Dot(normal, a - ExactOrigin(ray)), Dot(normal, ExactDirection(ray))};
}

int CompareExactly(const LocalRay& ray, const ExactIntersection::Corners& a,
                   const ExactIntersection::Corners& b) {
  const ExactParameter ta = ParameterOf(ray, a);
  const ExactParameter tb = ParameterOf(ray, b);
  const int difference = (ta.numerator * tb.denominator - tb.numerator * ta.denominator).Sign();
  return difference * ta.denominator.Sign() * tb.denominator.Sign();
}

/// A quotient as the caller's t.
double AsAnswered(double t) { return ToCallerT(t, 0); }

double ExactT(const LocalRay& ray, const ExactIntersection::Corners& triangle) {
  const ExactParameter t = ParameterOf(ray, triangle);
  return AsAnswered(Dyadic::Quotient(t.numerator, t.denominator));
}

/// Rounds as RoundsToWeight.
double ExactWeight(const Dyadic& volume, const Dyadic& sum) {
  const double weight = Dyadic::Quotient(volume, sum);
  if (weight >= kSmallWeight) return weight;
  return Dyadic::Quotient(volume + Dyadic(kSmallWeight) * sum, sum) - kSmallWeight;
}

struct Weights {
  double u, v;
};
/// With the names of RoundedRay::Solve.
Weights ExactWeights(const LocalRay& ray, const ExactIntersection::Corners& triangle) {
  const DyadicVec3 a = Exactly(triangle[0]), d = ExactDirection(ray);
  const DyadicVec3 e = Exactly(triangle[1]) - a, f = Exactly(triangle[2]) - a;
  const DyadicVec3 g = ExactOrigin(ray) - a;
  const DyadicVec3 fd = Cross(f, d);
  const Dyadic sum = Dot(e, fd);
  return {ExactWeight(Dot(g, fd), sum), ExactWeight(Dot(d, Cross(e, g)), sum)};
}

/// The corner that a hit meets, or -1.
int CornerMet(const ExactIntersection::Hit& hit) {
  for (int corner = 0; corner < 3; ++corner) {
    const auto others = [&](int k) { return hit.on_edge[static_cast<std::size_t>(k)]; };
    if (others((corner + 1) % 3) && others((corner + 2) % 3)) return corner;
  }
  return -1;
}
/// The edge that a hit meets, by the corner opposite, or -1.
int EdgeMet(const ExactIntersection::Hit& hit) {
  return hit.on_edge[0] ? 0 : hit.on_edge[1] ? 1 : hit.on_edge[2] ? 2 : -1;
}

/// True only if two triangles are hit at equal t because they share the corner that is hit, the
/// ends of the edge that is hit, or all corners.
bool ShareWhatIsHit(const ExactIntersection::Hit& hit, const ExactIntersection::Corners& corners,
                    const ExactIntersection::Hit& other,
                    const ExactIntersection::Corners& other_corners) {
  const auto at = [&](int k) { return corners[static_cast<std::size_t>(k % 3)]; };
  const auto other_at = [&](int k) { return other_corners[static_cast<std::size_t>(k % 3)]; };
  const int corner = CornerMet(hit), other_corner = CornerMet(other);
  if (corner >= 0 && other_corner >= 0 && at(corner) == other_at(other_corner)) return true;
  const int edge = EdgeMet(hit), other_edge = EdgeMet(other);
  if (edge >= 0 && other_edge >= 0) {
    const Vec3d p = at(edge + 1), q = at(edge + 2);
    const Vec3d r = other_at(other_edge + 1), s = other_at(other_edge + 2);
    if ((p == r && q == s) || (p == s && q == r)) return true;
  }
  const auto is_other = [&](const Vec3d& corner_of_one) {
    return corner_of_one == other_at(0) || corner_of_one == other_at(1) ||
           corner_of_one == other_at(2);
  };
  return is_other(at(0)) && is_other(at(1)) && is_other(at(2));
}

}  // namespace

ExactIntersection::ExactIntersection(const LocalRay& ray)
    : ray_(ray),
      rounded_(ray),
      t_min_(RoundedRay::BoundOf(ray.t_min, ray)),
      t_max_(RoundedRay::BoundOf(ray.t_max, ray)) {
  for (int axis = 0; axis < 3; ++axis) {
    const auto k = static_cast<std::size_t>(axis);
    const DoubleDouble moved = TwoDifference(ray.given->origin[axis], ray.frame->origin[axis]);
    is_parallel_[k] = ray.given->direction[axis] == 0;
    is_axis_exact_[k] = (is_parallel_[k] || ray.origin_error == 0) && moved.low == 0 &&
                        ScaleByPowerOfTwo(ray.origin[axis], ray.frame->exponent) == moved.high;
  }
}

inline auto ExactIntersection::EdgeVolume(const RoundedRay::Relative& p,
                                          const RoundedRay::Relative& q, const Vec3d& p_exact,
                                          const Vec3d& q_exact) const -> Volume {
  const auto [value, error] = rounded_.EdgeVolume(p, q);
  if (std::fabs(value) > error) return {value > 0 ? 1 : -1, value, error};
  return EdgeVolumeInDoubt(p, q, p_exact, q_exact);
}

auto ExactIntersection::EdgeVolumeInDoubt(const RoundedRay::Relative& p,
                                          const RoundedRay::Relative& q, const Vec3d& p_exact,
                                          const Vec3d& q_exact) const -> Volume {
  if (CancelsOut(p, q, p_exact, q_exact)) return {0, 0, 0};
  const BoundedNumber volume = rounded_.EdgeVolume(p_exact, q_exact);
  const double value = volume.value.high;
  if (std::fabs(value) > 2 * volume.error) {
    return {value > 0 ? 1 : -1, value, 2 * (volume.error + kUnit * std::fabs(value))};
  }
  const DyadicVec3 origin = ExactOrigin(ray_);
  const Dyadic exact =
      Dot(ExactDirection(ray_), Cross(Exactly(p_exact) - origin, Exactly(q_exact) - origin));
  if (exact.Sign() == 0) return {0, 0, 0};
  return {exact.Sign(), value, 2 * volume.error};
}

bool ExactIntersection::CancelsOut(const RoundedRay::Relative& p, const RoundedRay::Relative& q,
                                   const Vec3d& p_exact, const Vec3d& q_exact) const {
  const auto is_exact = [&](const Vec3d& corner, int axis) {
    return is_axis_exact_[static_cast<std::size_t>(axis)] &&
           TwoDifference(corner[axis], rounded_.origin[axis]).low == 0;
  };
  for (int axis = 0; axis < 3; ++axis) {
    if (is_parallel_[static_cast<std::size_t>(axis)]) continue;
    const int i = axis == 2 ? 0 : axis + 1;
    const int j = i == 2 ? 0 : i + 1;
    if (!(is_exact(p_exact, i) && is_exact(p_exact, j) && is_exact(q_exact, i) &&
          is_exact(q_exact, j))) {
      return false;
    }
    const bool left_is_zero = p.at[i] == 0 || q.at[j] == 0;
    const bool right_is_zero = p.at[j] == 0 || q.at[i] == 0;
    if (left_is_zero && right_is_zero) continue;
    const DoubleDouble left = TwoProduct(p.at[i], q.at[j]);
    const DoubleDouble right = TwoProduct(p.at[j], q.at[i]);
    // For smaller numbers, the rounding errors may have underflowed.
    if (!(std::fabs(left.high) > 0x1p-900)) return false;
    if (left.high != right.high || left.low != right.low) return false;
  }
  return true;
}

bool ExactIntersection::Test(const Vec3d& a, const Vec3d& b, const Vec3d& c, Hit* hit) const {
  const RoundedRay::Relative ra = rounded_.RelativeTo(a), rb = rounded_.RelativeTo(b),
                             rc = rounded_.RelativeTo(c);
  const Volume wa = EdgeVolume(rb, rc, b, c);
  const Volume wb = EdgeVolume(rc, ra, c, a);
  if (wa.sign * wb.sign < 0) return false;
  const Volume wc = EdgeVolume(ra, rb, a, b);
  const bool any_negative = wa.sign < 0 || wb.sign < 0 || wc.sign < 0;
  const bool any_positive = wa.sign > 0 || wb.sign > 0 || wc.sign > 0;
  if (any_negative == any_positive) return false;  // outside, or all 0: the ray lies in the plane
  hit->side = any_positive ? 1 : -1;
  hit->on_edge = {wa.sign == 0, wb.sign == 0, wc.sign == 0};

  // The mean of the corners' parameters, weighted by the volumes: between the least and the largest
  // of them, each with an error of 4 units and the origin's rounding. The error of the mean is at
  // most the ratio of the volumes' errors to their sum, times the distance between the parameters.
  const int axis = std::fabs(ray_.direction.x) >= 1 ? 0 : std::fabs(ray_.direction.y) >= 1 ? 1 : 2;
  const double inverse = 1 / ray_.direction[axis];
  const double sa = ra.at[axis] * inverse, sb = rb.at[axis] * inverse, sc = rc.at[axis] * inverse;
  const double least = std::min({sa, sb, sc}), most = std::max({sa, sb, sc});
  const double size = std::max({ra.size, rb.size, rc.size});
  const double room = 0x1p-48 * size + 8 * rounded_.origin_rounding + 0x1p-150;
  const double sum = wa.value + wb.value + wc.value;
  const double mean = (wa.value * sa + wb.value * sb + wc.value * sc) / sum;
  const double doubt = 4 * (wa.error + wb.error + wc.error) / std::fabs(sum) * (most - least);
  hit->low = least - room;
  hit->high = most + room;
  if (doubt + room < most - least) {  // false for NaN, if the volumes are too small to sum
    hit->low = std::max(hit->low, mean - doubt - room);
    hit->high = std::min(hit->high, mean + doubt + room);
  }
  return true;
}

bool ExactIntersection::OwnsCrossing(const Vec3d& a, const Vec3d& b, const Vec3d& c,
                                     const Hit& hit) const {
  return (!hit.on_edge[0] || MovedSign(b, c) == hit.side) &&
         (!hit.on_edge[1] || MovedSign(c, a) == hit.side) &&
         (!hit.on_edge[2] || MovedSign(a, b) == hit.side);
}

// With the origin moved by m, the volume direction . ((p - origin) x (q - origin)) grows by m . ((p
// - q) x direction). For m = (e, e^2, e^3) the first nonzero component of the product decides.
int ExactIntersection::MovedSign(const Vec3d& p, const Vec3d& q) const {
  const Vec3d edge = p - q;
  const Vec3d& d = ray_.direction;
  const Vec3d& given = ray_.given->direction;
  for (int axis = 0; axis < 3; ++axis) {
    const int i = axis == 2 ? 0 : axis + 1;
    const int j = i == 2 ? 0 : i + 1;
    const double left = edge[i] * d[j];
    const double right = edge[j] * d[i];
    const double value = left - right;
    // Three roundings on the way to each product and their difference; then underflow.
    const double bound = 4 * kUnit * (std::fabs(left) + std::fabs(right)) + 0x1p-1070;
    if (std::fabs(value) > bound) return value > 0 ? 1 : -1;
    // A rounded difference is 0 only if the corners' coordinates are equal.
    if ((edge[i] == 0 || given[j] == 0) && (edge[j] == 0 || given[i] == 0)) continue;
    const DyadicVec3 edge_exact = Exactly(p) - Exactly(q);
    const DyadicVec3 product = Cross(edge_exact, ExactDirection(ray_));
    const int sign = (axis == 0 ? product.x : axis == 1 ? product.y : product.z).Sign();
    if (sign != 0) return sign;
  }
  return 0;
}

int ExactIntersection::CompareInDoubt(const Hit& hit, const Corners& corners, const Hit& other,
                                      const Corners& other_corners) const {
  if (ShareWhatIsHit(hit, corners, other, other_corners)) return 0;
  const BoundedNumber s = rounded_.Solve(corners[0], corners[1], corners[2]).s;
  const BoundedNumber other_s =
      rounded_.Solve(other_corners[0], other_corners[1], other_corners[2]).s;
  const double difference = (s.value - other_s.value).high;
  if (std::fabs(difference) > 2 * (s.error + other_s.error)) return difference < 0 ? -1 : 1;
  return CompareExactly(ray_, corners, other_corners);
}

// Above 2^-1022, where it is not rounded twice.
double ExactIntersection::RoundT(const BoundedNumber& s, const Corners& corners) const {
  double along = 0;
  if (RoundsTo(rounded_.Along(s), &along)) {
    const double t = ToCallerT(along, ray_.exponent);
    if (std::fabs(t) >= std::numeric_limits<double>::min()) return t;
  }
  return ExactT(ray_, corners);
}

double ExactIntersection::FindT(const Corners& corners) const {
  return RoundT(rounded_.Solve(corners[0], corners[1], corners[2]).s, corners);
}

core::Hit ExactIntersection::Answer(PrimitiveId id, const Corners& corners) const {
  const RoundedRay::Solution found = rounded_.Solve(corners[0], corners[1], corners[2]);
  core::Hit answer;
  answer.t = RoundT(found.s, corners);
  if (!RoundsToWeight(found.u, &answer.u) || !RoundsToWeight(found.v, &answer.v)) {
    const Weights exact = ExactWeights(ray_, corners);
    answer.u = exact.u;
    answer.v = exact.v;
  }
  answer.primitive_id = id;
  return answer;
}

}  // namespace kdray::core
