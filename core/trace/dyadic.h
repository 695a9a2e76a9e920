// Numbers m * 2^e with integers of any size: sums and products of doubles without rounding,
// underflow or overflow. The last resort of exact mode, reached when a filter in double cannot
// decide (some 1 in 1000 signs). GMP does the work.
#pragma once

#include <gmpxx.h>

#include <utility>

namespace kdray::core {

class Dyadic {
 public:
  Dyadic() = default;             ///< 0
  explicit Dyadic(double value);  ///< exact; value must be finite

  friend Dyadic operator+(const Dyadic& a, const Dyadic& b);
  friend Dyadic operator-(const Dyadic& a, const Dyadic& b);
  friend Dyadic operator*(const Dyadic& a, const Dyadic& b);

  /// This times 2^exponent, exactly.
  Dyadic TimesPowerOfTwo(int exponent) const { return Dyadic(mantissa_, exponent_ + exponent); }
  int Sign() const { return sgn(mantissa_); }

  /// numerator / denominator (not 0) rounded to nearest, ties to even, in the range of normal
  /// doubles; below it the result may be rounded twice, above it is infinite.
  static double Quotient(const Dyadic& numerator, const Dyadic& denominator);

 private:
  Dyadic(mpz_class mantissa, long exponent) : mantissa_(std::move(mantissa)), exponent_(exponent) {}

  mpz_class mantissa_;
  long exponent_ = 0;
};

}  // namespace kdray::core
