// SPDX-License-Identifier: Apache-2.0
#include "core/proximity/exact_distance.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>

#include "core/geometry/dyadic.h"
#include "core/proximity/point_triangle.h"

namespace kdray::core {
namespace {

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

DyadicVec3 ExactLocal(const Vec3d& world, const MeshFrame& frame) {
  const DyadicVec3 moved = Exactly(world) - Exactly(frame.origin);
  return {moved.x.TimesPowerOfTwo(-frame.exponent), moved.y.TimesPowerOfTwo(-frame.exponent),
          moved.z.TimesPowerOfTwo(-frame.exponent)};
}

/// The closest point of a triangle is (a * weight_a + b * weight_b + c * weight_c) / total, and the
/// squared distance numerator / denominator.
struct Foot {
  Dyadic numerator, denominator;
  Dyadic weight_b, weight_c, total;
};

/// Sign of a / b - c / d for positive b and d.
int CompareFractions(const Dyadic& a, const Dyadic& b, const Dyadic& c, const Dyadic& d) {
  return (a * d - c * b).Sign();
}

/// Offers an edge's closest point, which is `best` if it is closer. `weight(t, length)` sets the
/// weights for the point at t / length between the ends.
template <class SetWeights>
void OfferEdge(const DyadicVec3& p, const DyadicVec3& from, const DyadicVec3& to,
               const SetWeights& set_weights, bool* has_best, Foot* best) {
  const DyadicVec3 along = to - from, at = p - from;
  const Dyadic length = Dot(along, along);  // squared
  Dyadic t = Dot(at, along);
  Foot foot;
  if (t.Sign() <= 0) {
    t = Dyadic();
    foot.numerator = Dot(at, at);
    foot.denominator = Dyadic(1.0);
  } else if ((t - length).Sign() >= 0) {
    t = length;
    const DyadicVec3 back = p - to;
    foot.numerator = Dot(back, back);
    foot.denominator = Dyadic(1.0);
  } else {
    foot.numerator = Dot(at, at) * length - t * t;
    foot.denominator = length;
  }
  if (*has_best &&
      CompareFractions(foot.numerator, foot.denominator, best->numerator, best->denominator) >= 0) {
    return;
  }
  foot.total = length;
  set_weights(t, length, &foot);
  *best = foot;
  *has_best = true;
}

Foot FootOf(const DyadicVec3& p, const TriangleCorners& triangle) {
  const DyadicVec3 a = Exactly(triangle[0]), b = Exactly(triangle[1]), c = Exactly(triangle[2]);
  const DyadicVec3 ab = b - a, ac = c - a, ap = p - a;
  const DyadicVec3 normal = Cross(ab, ac);
  const Dyadic square = Dot(normal, normal);
  const Dyadic side_b = Dot(normal, Cross(ap, ac)), side_c = Dot(normal, Cross(ab, ap));
  const Dyadic side_a = square - side_b - side_c;
  Foot foot;
  if (side_a.Sign() >= 0 && side_b.Sign() >= 0 && side_c.Sign() >= 0) {
    const Dyadic height = Dot(normal, ap);
    foot.numerator = height * height;
    foot.denominator = foot.total = square;
    foot.weight_b = side_b;
    foot.weight_c = side_c;
    return foot;
  }
  // The closest point lies on an edge that separates the point from the triangle.
  bool has_best = false;
  if (side_c.Sign() < 0) {
    OfferEdge(
        p, a, b, [](const Dyadic& t, const Dyadic&, Foot* f) { f->weight_b = t; }, &has_best,
        &foot);
  }
  if (side_a.Sign() < 0) {
    OfferEdge(
        p, b, c,
        [](const Dyadic& t, const Dyadic& length, Foot* f) {
          f->weight_b = length - t;
          f->weight_c = t;
        },
        &has_best, &foot);
  }
  if (side_b.Sign() < 0) {
    OfferEdge(
        p, c, a, [](const Dyadic& t, const Dyadic& length, Foot* f) { f->weight_c = length - t; },
        &has_best, &foot);
  }
  return foot;
}

/// The square root of numerator / denominator times 2^exponent, rounded to the nearest double.
double RoundedRoot(const Dyadic& numerator, const Dyadic& denominator, int exponent) {
  if (numerator.Sign() == 0) return 0;
  // The fraction times 2^-2k is in [1/4, 4).
  const long difference = numerator.Exponent() - denominator.Exponent();
  const long k = difference >= 0 ? difference / 2 : -((1 - difference) / 2);
  const Dyadic scaled = numerator.TimesPowerOfTwo(static_cast<int>(-2 * k));
  double root = std::sqrt(Dyadic::Quotient(scaled, denominator));
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  // The sign of the root minus the middle between `root` and its neighbour.
  const auto beyond_middle = [&](double neighbour) {
    const Dyadic middle = (Dyadic(root) + Dyadic(neighbour)).TimesPowerOfTwo(-1);
    return (scaled - middle * middle * denominator).Sign();
  };
  const auto is_odd = [](double x) {
    return std::fmod(std::scalbn(x, 52 - std::ilogb(x)), 2) != 0;
  };
  for (double above = std::nextafter(root, kInfinity);; above = std::nextafter(root, kInfinity)) {
    const int side = beyond_middle(above);
    if (side < 0 || (side == 0 && !is_odd(root))) break;
    root = above;
  }
  for (double below = std::nextafter(root, 0.0);; below = std::nextafter(root, 0.0)) {
    const int side = beyond_middle(below);
    if (side > 0 || (side == 0 && !is_odd(root))) break;
    root = below;
  }
  const long all = k + exponent;
  constexpr long kBeyond = 4000;
  const double distance = std::ldexp(root, static_cast<int>(std::clamp(all, -kBeyond, kBeyond)));
  return std::min(distance, std::numeric_limits<double>::max());
}

}  // namespace

ExactPoint::ExactPoint(const Vec3d& world, const MeshFrame& frame)
    : world_(world),
      frame_(&frame),
      local_(frame.ToLocal(world)),
      is_near_(MaxAbs(local_) <= 0x1p20) {}

// The filter's error bounds: a few roundings of products of lengths; the point's rounding moves it
// by 2^-53 of its size.
auto ExactPoint::CertainPart(const TriangleCorners& t) const -> std::optional<SharedPart> {
  if (!is_near_) return std::nullopt;
  const double size = MaxAbs(local_) + 1;
  // Of corner k: the dot products of the way to the point with the ways to the other corners.
  struct Ways {
    double to_next, to_last;
    double room_next, room_last;
  };
  std::array<Ways, 3> ways;
  for (std::size_t k = 0; k < 3; ++k) {
    const Vec3d at = local_ - t[k];
    const Vec3d next = t[(k + 1) % 3] - t[k], last = t[(k + 2) % 3] - t[k];
    const double room = 0x1p-47 * (MaxAbs(at) + 0x1p-3 * size);
    ways[k] = {Dot(at, next), Dot(at, last), room * MaxAbs(next) + 0x1p-1000,
               room * MaxAbs(last) + 0x1p-1000};
  }
  for (std::size_t k = 0; k < 3; ++k) {
    if (ways[k].to_next < -ways[k].room_next && ways[k].to_last < -ways[k].room_last) {
      return SharedPart{t[k], t[k]};
    }
  }
  for (std::size_t k = 0; k < 3; ++k) {
    const std::size_t n = (k + 1) % 3, o = (k + 2) % 3;
    if (!(ways[k].to_next > ways[k].room_next && ways[n].to_last > ways[n].room_last)) continue;
    const Vec3d edge = t[n] - t[k], other = t[o] - t[k], at = local_ - t[k];
    const double lengths = MaxAbs(edge) * MaxAbs(edge) * MaxAbs(other);
    const double side = Dot(Cross(edge, other), Cross(edge, at));
    if (!(side < -(0x1p-44 * lengths * (MaxAbs(at) + size) + 0x1p-1000))) continue;
    const Vec3d &p = t[k], &q = t[n];
    const bool swapped = std::tie(q.x, q.y, q.z) < std::tie(p.x, p.y, p.z);
    return swapped ? SharedPart{q, p} : SharedPart{p, q};
  }
  return std::nullopt;
}

int ExactPoint::Compare(const TriangleCorners& a, const TriangleCorners& b) const {
  const std::optional<SharedPart> part_a = CertainPart(a);
  if (part_a && part_a == CertainPart(b)) return 0;
  const auto is_corner_of_b = [&](const Vec3d& p) { return p == b[0] || p == b[1] || p == b[2]; };
  if (is_corner_of_b(a[0]) && is_corner_of_b(a[1]) && is_corner_of_b(a[2])) return 0;
  const DyadicVec3 p = ExactLocal(world_, *frame_);
  const Foot foot_a = FootOf(p, a), foot_b = FootOf(p, b);
  return CompareFractions(foot_a.numerator, foot_a.denominator, foot_b.numerator,
                          foot_b.denominator);
}

bool ExactPoint::IsOn(const TriangleCorners& triangle) const {
  return FootOf(ExactLocal(world_, *frame_), triangle).numerator.Sign() == 0;
}

ExactFoot ExactPoint::FootOn(const TriangleCorners& triangle) const {
  const Foot foot = FootOf(ExactLocal(world_, *frame_), triangle);
  ExactFoot answer;
  answer.distance = RoundedRoot(foot.numerator, foot.denominator, frame_->exponent);
  answer.u = Dyadic::Quotient(foot.weight_b, foot.total);
  answer.v = Dyadic::Quotient(foot.weight_c, foot.total);
  const Dyadic weight_a = foot.total - foot.weight_b - foot.weight_c;
  for (int axis = 0; axis < 3; ++axis) {
    const Dyadic local = Dyadic(triangle[0][axis]) * weight_a +
                         Dyadic(triangle[1][axis]) * foot.weight_b +
                         Dyadic(triangle[2][axis]) * foot.weight_c;
    const Dyadic world =
        local.TimesPowerOfTwo(frame_->exponent) + Dyadic(frame_->origin[axis]) * foot.total;
    answer.point[axis] = Dyadic::Quotient(world, foot.total) + 0.0;
  }
  return answer;
}

}  // namespace kdray::core
