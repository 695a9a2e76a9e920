#include "core/trace/dyadic.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>

namespace kdray::core {

Dyadic::Dyadic(double value) {
  assert(std::isfinite(value));
  if (value == 0) return;
  int exponent = 0;
  const double fraction = std::frexp(value, &exponent);
  mantissa_ = std::ldexp(fraction, 53);  // an integer below 2^53: exact
  exponent_ = exponent - 53;
}

Dyadic operator*(const Dyadic& a, const Dyadic& b) {
  return Dyadic(a.mantissa_ * b.mantissa_, a.exponent_ + b.exponent_);
}

Dyadic operator+(const Dyadic& a, const Dyadic& b) {
  if (a.Sign() == 0) return b;
  if (b.Sign() == 0) return a;
  const long exponent = std::min(a.exponent_, b.exponent_);
  const mpz_class a_shifted = a.mantissa_ << static_cast<unsigned long>(a.exponent_ - exponent);
  const mpz_class b_shifted = b.mantissa_ << static_cast<unsigned long>(b.exponent_ - exponent);
  return Dyadic(a_shifted + b_shifted, exponent);
}

Dyadic operator-(const Dyadic& a, const Dyadic& b) { return a + Dyadic(-b.mantissa_, b.exponent_); }

double Dyadic::Quotient(const Dyadic& numerator, const Dyadic& denominator) {
  assert(denominator.Sign() != 0);
  if (numerator.Sign() == 0) return 0;
  const bool negative = (numerator.Sign() < 0) != (denominator.Sign() < 0);
  const mpz_class n = abs(numerator.mantissa_);
  const mpz_class d = abs(denominator.mantissa_);

  // A quotient of 55 or 56 bits: 53 for the result, two or three to round by; what is cut off
  // behind sets the last bit.
  const long bits_n = static_cast<long>(mpz_sizeinbase(n.get_mpz_t(), 2));
  const long bits_d = static_cast<long>(mpz_sizeinbase(d.get_mpz_t(), 2));
  const long shift = 55 - (bits_n - bits_d);
  mpz_class quotient, rest;
  if (shift >= 0) {
    const mpz_class shifted = n << static_cast<unsigned long>(shift);
    mpz_tdiv_qr(quotient.get_mpz_t(), rest.get_mpz_t(), shifted.get_mpz_t(), d.get_mpz_t());
  } else {
    const mpz_class shifted = d << static_cast<unsigned long>(-shift);
    mpz_tdiv_qr(quotient.get_mpz_t(), rest.get_mpz_t(), n.get_mpz_t(), shifted.get_mpz_t());
  }
  static_assert(sizeof(unsigned long) == 8);
  unsigned long bits = quotient.get_ui();
  if (sgn(rest) != 0) bits |= 1;
  // 56 bits at most, so rounding to 53 is one conversion, correct because the sticky bit is below
  // the rounding bit.
  const double rounded = static_cast<double>(bits);
  const long exponent = numerator.exponent_ - denominator.exponent_ - shift;
  constexpr long kFarOut = 5000;
  const double magnitude =
      std::ldexp(rounded, static_cast<int>(std::clamp(exponent, -kFarOut, kFarOut)));
  return negative ? -magnitude : magnitude;
}

}  // namespace kdray::core
