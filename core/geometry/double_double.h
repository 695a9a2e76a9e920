// SPDX-License-Identifier: Apache-2.0
// Unevaluated sums of two doubles, some 106 bits: the stage between a filter in double and exact
// integers.
#pragma once

#include <cmath>

namespace kdray::core {

/// high + low with |low| <= ulp(high) / 2. Each operation below is exact or has a relative error
/// below 2^-102, unless it underflows. Source: Dekker 1971; Joldes, Muller, Popescu, "Tight and
/// rigorous error bounds for basic building blocks of double-word arithmetic", ACM TOMS 44(2),
/// 2017. Always inlined: in a caller compiled for fused multiply-add, std::fma becomes one
/// instruction.
struct DoubleDouble {
  double high = 0;
  double low = 0;
};

/// a + b exactly.
[[gnu::always_inline]] inline DoubleDouble TwoSum(double a, double b) {
  const double sum = a + b;
  const double b_part = sum - a;
  return {sum, (a - (sum - b_part)) + (b - b_part)};
}

/// a - b exactly.
[[gnu::always_inline]] inline DoubleDouble TwoDifference(double a, double b) {
  return TwoSum(a, -b);
}

/// a * b exactly.
[[gnu::always_inline]] inline DoubleDouble TwoProduct(double a, double b) {
  const double product = a * b;
  return {product, std::fma(a, b, -product)};
}

/// a + b exactly when |a| >= |b|.
[[gnu::always_inline]] inline DoubleDouble FastTwoSum(double a, double b) {
  const double sum = a + b;
  return {sum, b - (sum - a)};
}

[[gnu::always_inline]] inline DoubleDouble operator+(const DoubleDouble& a, const DoubleDouble& b) {
  const DoubleDouble high = TwoSum(a.high, b.high);
  const DoubleDouble low = TwoSum(a.low, b.low);
  const DoubleDouble sum = FastTwoSum(high.high, high.low + low.high);
  return FastTwoSum(sum.high, sum.low + low.low);
}
[[gnu::always_inline]] inline DoubleDouble operator-(const DoubleDouble& a) {
  return {-a.high, -a.low};
}
[[gnu::always_inline]] inline DoubleDouble operator-(const DoubleDouble& a, const DoubleDouble& b) {
  return a + (-b);
}

[[gnu::always_inline]] inline DoubleDouble operator*(const DoubleDouble& a, const DoubleDouble& b) {
  const DoubleDouble high = TwoProduct(a.high, b.high);
  return FastTwoSum(high.high, high.low + (a.high * b.low + a.low * b.high));
}

/// a / b to within a few 2^-104; b not 0.
[[gnu::always_inline]] inline DoubleDouble operator/(const DoubleDouble& a, const DoubleDouble& b) {
  const double first = a.high / b.high;
  const DoubleDouble rest = a - b * DoubleDouble{first, 0};
  const double second = rest.high / b.high;
  return FastTwoSum(first, second);
}

}  // namespace kdray::core
