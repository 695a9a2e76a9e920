// SPDX-License-Identifier: Apache-2.0
// Numbers m * 2^e with large integers m: sums and products of doubles without rounding, underflow
// or overflow. The last resort of the precision `exact`, for signs and orders that neither a filter
// in double nor double-double arithmetic decides. Computed by GMP's functions on fixed arrays, so
// nothing is allocated.
#pragma once

#include <gmp.h>

namespace kdray::core {

/// Results must fit kLimbs. With coordinates of a mesh in its frame (at most 1, multiples of
/// 2^-1074), and an origin and a direction of doubles that are scaled into that frame, an origin
/// takes 50 limbs, a direction 33, a triangle's normal 34, and the largest products, which compare
/// two hits and the distances from a point to two planes, 151 and 236.
class Dyadic {
 public:
  Dyadic() = default;             ///< 0
  explicit Dyadic(double value);  ///< exact; value must be finite
  Dyadic(const Dyadic& other) { CopyFrom(other); }
  Dyadic& operator=(const Dyadic& other) {
    if (this != &other) CopyFrom(other);
    return *this;
  }

  friend Dyadic operator+(const Dyadic& a, const Dyadic& b) { return Sum(a, b, b.sign_); }
  friend Dyadic operator-(const Dyadic& a, const Dyadic& b) { return Sum(a, b, -b.sign_); }
  friend Dyadic operator*(const Dyadic& a, const Dyadic& b);

  /// *this * 2^exponent, exactly.
  Dyadic TimesPowerOfTwo(int exponent) const {
    Dyadic product(*this);
    product.exponent_ += exponent;
    return product;
  }
  int Sign() const { return sign_; }
  /// Rounded to nearest, ties to even; infinite beyond the range of double.
  double ToDouble() const { return Quotient(*this, Dyadic(1.0)); }
  /// The largest n with 2^n <= |*this|, which is not 0.
  long Exponent() const;

  /// numerator / denominator (not 0), rounded to nearest, ties to even; infinite beyond the range
  /// of double.
  static double Quotient(const Dyadic& numerator, const Dyadic& denominator);
  /// The same to a multiple of 2^exponent, rounded towards 0.
  static Dyadic Quotient(const Dyadic& numerator, const Dyadic& denominator, int exponent);

 private:
  static constexpr int kLimbs = 256;
  static constexpr int kLimbBits = 64;
  static_assert(GMP_LIMB_BITS == kLimbBits);

  static Dyadic Sum(const Dyadic& a, const Dyadic& b, int sign_of_b);
  void CopyFrom(const Dyadic& other);
  /// |value| * 2^bits; bits >= 0.
  void SetShifted(const Dyadic& value, long bits);
  void DropZeros();
  long Bits() const;  // of the mantissa

  // Not initialised beyond size_; size_ is 0 exactly when sign_ is 0.
  mp_limb_t limbs_[kLimbs];
  int size_ = 0;
  int sign_ = 0;
  long exponent_ = 0;
};

}  // namespace kdray::core
