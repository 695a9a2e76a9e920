// SPDX-License-Identifier: Apache-2.0
#include "core/geometry/predicates.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace kdray::core {
namespace {

struct TwoTerms {
  double high;
  double low;  // what rounding `high` lost, exactly
};

TwoTerms TwoSum(double a, double b) {
  const double high = a + b;
  const double b_part = high - a;
  const double a_part = high - b_part;
  return {high, (a - a_part) + (b - b_part)};
}

TwoTerms TwoProduct(double a, double b) {
  const double high = a * b;
  return {high, std::fma(a, b, -high)};
}

// An exact sum: components that do not overlap, smallest first, none of them zero. The sign of the
// sum is that of the last one. Shewchuk 1997, section 2.4 (Grow-Expansion).
class ExactSum {
 public:
  void Add(double term) {
    double carry = term;
    int kept = 0;
    for (int i = 0; i < size_; ++i) {
      const TwoTerms sum = TwoSum(carry, parts_[static_cast<std::size_t>(i)]);
      carry = sum.high;
      if (sum.low != 0) parts_[static_cast<std::size_t>(kept++)] = sum.low;
    }
    if (carry != 0) parts_[static_cast<std::size_t>(kept++)] = carry;
    size_ = kept;
  }
  void AddProduct(double a, double b) {
    const TwoTerms product = TwoProduct(a, b);
    Add(product.low);
    Add(product.high);
  }
  int Sign() const {
    if (size_ == 0) return 0;
    return parts_[static_cast<std::size_t>(size_ - 1)] > 0 ? 1 : -1;
  }

 private:
  std::array<double, 12> parts_;  // six products of two terms each
  int size_ = 0;
};

// The determinant multiplied out: six products of the coordinates themselves, so that no difference
// is rounded. The largest coordinate is scaled to about 2^500: products then stay below 2^1002, and
// their last bits above 2^-1074 when the smallest coordinate is 2^-984 of the largest.
int ExactOrient2d(Point2 a, Point2 b, Point2 c) {
  const double largest = std::max({std::fabs(a.x), std::fabs(a.y), std::fabs(b.x), std::fabs(b.y),
                                   std::fabs(c.x), std::fabs(c.y)});
  if (largest == 0) return 0;
  const int scale = 500 - std::ilogb(largest);
  for (Point2* p : {&a, &b, &c}) *p = {std::ldexp(p->x, scale), std::ldexp(p->y, scale)};
  ExactSum sum;
  sum.AddProduct(a.x, b.y);
  sum.AddProduct(-a.y, b.x);
  sum.AddProduct(b.x, c.y);
  sum.AddProduct(-b.y, c.x);
  sum.AddProduct(c.x, a.y);
  sum.AddProduct(-c.y, a.x);
  return sum.Sign();
}

}  // namespace

int Orient2d(Point2 a, Point2 b, Point2 c) {
  const double acx = a.x - c.x;
  const double acy = a.y - c.y;
  const double bcx = b.x - c.x;
  const double bcy = b.y - c.y;
  const double left = acx * bcy;
  const double right = acy * bcx;
  const double det = left - right;
  // Shewchuk's bound for this formula, (3 + 16e)e with e = 2^-53, and a term for underflow of the
  // products and of the bound itself. An overflow makes the bound infinite and the comparisons
  // false.
  constexpr double kRelativeError = (3.0 + 16.0 * 0x1p-53) * 0x1p-53;
  constexpr double kUnderflow = 0x1p-1070;
  const double bound = kRelativeError * (std::fabs(left) + std::fabs(right)) + kUnderflow;
  if (det > bound) return 1;
  if (det < -bound) return -1;
  // A difference is 0 only if its two numbers are equal. This decides the common case of points in
  // an axis-parallel line or plane.
  if ((acx == 0 || bcy == 0) && (acy == 0 || bcx == 0)) return 0;
  return ExactOrient2d(a, b, c);
}

bool AreCollinear(const Vec3d& a, const Vec3d& b, const Vec3d& c) {
  for (int axis = 0; axis < 3; ++axis) {
    if (Orient2d(DropAxis(a, axis), DropAxis(b, axis), DropAxis(c, axis)) != 0) return false;
  }
  return true;
}

}  // namespace kdray::core
