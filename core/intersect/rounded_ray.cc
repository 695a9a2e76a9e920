// SPDX-License-Identifier: Apache-2.0
#include "core/intersect/rounded_ray.h"

namespace kdray::core {
namespace {

/// A vector in double-double, and the sizes of its summands.
struct SizedVector {
  DoubleDouble at[3];
  double size[3];
};

SizedVector Difference(const Vec3d& a, const Vec3d& b) {
  SizedVector difference;
  for (int k = 0; k < 3; ++k) {
    difference.at[k] = TwoDifference(a[k], b[k]);
    difference.size[k] = std::fabs(difference.at[k].high);
  }
  return difference;
}

SizedVector Cross(const SizedVector& a, const SizedVector& b) {
  SizedVector product;
  for (int k = 0; k < 3; ++k) {
    const int i = k == 2 ? 0 : k + 1;
    const int j = i == 2 ? 0 : i + 1;
    product.at[k] = a.at[i] * b.at[j] - a.at[j] * b.at[i];
    product.size[k] = a.size[i] * b.size[j] + a.size[j] * b.size[i];
  }
  return product;
}

struct SizedNumber {
  DoubleDouble value;
  double error;
};
SizedNumber Dot(const SizedVector& a, const SizedVector& b) {
  const DoubleDouble sum = (a.at[0] * b.at[0] + a.at[1] * b.at[1]) + a.at[2] * b.at[2];
  const double size = a.size[0] * b.size[0] + a.size[1] * b.size[1] + a.size[2] * b.size[2];
  return {sum, RoundedRay::kStep * size + RoundedRay::kUnderflow};
}

SizedVector Widened(const Vec3d& v) {
  SizedVector wide;
  for (int k = 0; k < 3; ++k) {
    wide.at[k] = {v[k], 0};
    wide.size[k] = std::fabs(v[k]);
  }
  return wide;
}

/// origin - point, with the origin's low part and error.
SizedVector FromPoint(const RoundedRay& ray, const Vec3d& point) {
  SizedVector vector;
  for (int k = 0; k < 3; ++k) {
    vector.at[k] = TwoDifference(ray.origin[k], point[k]) + DoubleDouble{ray.origin_low[k], 0};
    vector.size[k] = std::fabs(vector.at[k].high) + ray.OriginSize();
  }
  return vector;
}

BoundedNumber Ratio(const SizedNumber& numerator, const SizedNumber& denominator) {
  const double least = std::fabs(denominator.value.high);
  if (!(least > RoundedRay::kLeastDenominator && least > 4 * denominator.error)) return {};
  const DoubleDouble ratio = numerator.value / denominator.value;
  return {ratio, 2 * (numerator.error + std::fabs(ratio.high) * denominator.error) / least};
}

}  // namespace

// Double-double in which only the first doubles are computed exactly: the second ones are small
// enough for plain arithmetic, which halves the operations of Cross and Dot.
BoundedNumber RoundedRay::EdgeVolume(const Vec3d& p, const Vec3d& q) const {
  DoubleDouble from_p[3], from_q[3];
  double size_p[3], size_q[3];
  for (int k = 0; k < 3; ++k) {
    from_p[k] = TwoDifference(p[k], origin[k]);
    from_q[k] = TwoDifference(q[k], origin[k]);
    from_p[k].low -= origin_low[k];
    from_q[k].low -= origin_low[k];
    size_p[k] = std::fabs(from_p[k].high) + OriginSize();
    size_q[k] = std::fabs(from_q[k].high) + OriginSize();
  }
  double high = 0, low = 0, size = 0;
  for (int k = 0; k < 3; ++k) {
    const int i = k == 2 ? 0 : k + 1;
    const int j = i == 2 ? 0 : i + 1;
    const DoubleDouble left = TwoProduct(from_p[i].high, from_q[j].high);
    const DoubleDouble right = TwoProduct(from_p[j].high, from_q[i].high);
    const DoubleDouble difference = TwoDifference(left.high, right.high);
    const double rest = (difference.low + (left.low - right.low)) +
                        ((from_p[i].high * from_q[j].low + from_p[i].low * from_q[j].high) -
                         (from_p[j].high * from_q[i].low + from_p[j].low * from_q[i].high));
    const DoubleDouble term = TwoProduct(direction[k], difference.high);
    const DoubleDouble sum = TwoSum(high, term.high);
    high = sum.high;
    low += sum.low + (term.low + direction[k] * rest);
    size += std::fabs(direction[k]) * (size_p[i] * size_q[j] + size_p[j] * size_q[i]);
  }
  return {TwoSum(high, low), kStep * size + kUnderflow};
}

// With edges e = b - a, f = c - a and g = origin - a, the volumes opposite b and c are g.(f x d)
// and d.(e x g), all three add up to e.(f x d), and the ray meets the plane at f.(e x g) over that
// (Moeller and Trumbore 1997).
auto RoundedRay::Solve(const Vec3d& a, const Vec3d& b, const Vec3d& c) const -> Solution {
  const SizedVector d = Widened(direction);
  const SizedVector e = Difference(b, a), f = Difference(c, a), g = FromPoint(*this, a);
  const SizedVector fd = Cross(f, d), eg = Cross(e, g);
  const SizedNumber sum = Dot(e, fd);
  return {Ratio(Dot(f, eg), sum), Ratio(Dot(g, fd), sum), Ratio(Dot(d, eg), sum)};
}

}  // namespace kdray::core
