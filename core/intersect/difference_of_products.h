// SPDX-License-Identifier: Apache-2.0
// Differences of products with the exact sign: the arithmetic of every edge test.
#pragma once

#include <algorithm>
#include <cmath>

namespace kdray::core {

/// a*b - c*d to within two units in the last place, with the exact sign, and exactly the negative
/// of DifferenceOfProducts(c, d, a, b). Zero only if the exact value is zero (or all products are
/// below 2^-1022 + 106 bits). Source: Kahan's trick in the symmetric form (Jeannerod, Louvet,
/// Muller 2013 analyse the common one).
inline double DifferenceOfProducts(double a, double b, double c, double d) {
  const double ab = a * b;
  const double cd = c * d;
  const double ab_error = std::fma(a, b, -ab);
  const double cd_error = std::fma(c, d, -cd);
  return (ab - cd) + (ab_error - cd_error);
}

/// Sign of a*b - c*d as -1, 0 or 1, exact for floats: products of two floats are exact in double.
inline int SignOfDifference(float a, float b, float c, float d) {
  const double ab = static_cast<double>(a) * static_cast<double>(b);
  const double cd = static_cast<double>(c) * static_cast<double>(d);
  return (ab > cd) - (ab < cd);
}

/// The same for doubles. Rounding is monotonic, so different rounded products have the exact order;
/// for equal ones, the rounding errors decide.
inline int SignOfDifference(double a, double b, double c, double d) {
  const double ab = a * b;
  const double cd = c * d;
  if (ab != cd) return (ab > cd) - (ab < cd);
  const double ab_error = std::fma(a, b, -ab);
  const double cd_error = std::fma(c, d, -cd);
  return (ab_error > cd_error) - (ab_error < cd_error);
}

/// a + b + c in an order that depends only on the values, so rotating a triangle's corners changes
/// no bit.
inline double SymmetricSum(double a, double b, double c) {
  const double low = std::min({a, b, c});
  const double high = std::max({a, b, c});
  const double middle = std::max(std::min(a, b), std::min(std::max(a, b), c));
  return (low + high) + middle;
}

}  // namespace kdray::core
