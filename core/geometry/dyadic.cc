// SPDX-License-Identifier: Apache-2.0
#include "core/geometry/dyadic.h"

#include <algorithm>
#include <bit>
#include <cassert>
#include <cmath>
#include <cstdint>
#include <cstring>

namespace kdray::core {
namespace {

/// bits * 2^exponent, where the last of at least 55 bits stands for all that was cut off after it.
double Round(std::uint64_t bits, long exponent) {
  const long count = static_cast<long>(std::bit_width(bits));
  // Results below 2^-1022 have fewer digits; they too are rounded only once.
  const long digits = std::min(53L, count + exponent + 1074);
  if (digits < 0) return 0;
  const long dropped = count - digits;
  std::uint64_t kept = bits >> dropped;  // dropped is 2 to 57
  const std::uint64_t rest = bits - (kept << dropped);
  const std::uint64_t half = std::uint64_t{1} << (dropped - 1);
  if (rest > half || (rest == half && (kept & 1u) != 0)) ++kept;
  constexpr long kBeyond = 2000;  // all bits
  return std::ldexp(static_cast<double>(kept),
                    static_cast<int>(std::min(exponent + dropped, kBeyond)));
}

}  // namespace

Dyadic::Dyadic(double value) {
  assert(std::isfinite(value));
  if (value == 0) return;
  int exponent = 0;
  const double fraction = std::frexp(std::fabs(value), &exponent);
  // The mantissa is odd, so numbers with few digits stay short.
  const auto mantissa = static_cast<std::uint64_t>(std::ldexp(fraction, 53));
  const int zeros = std::countr_zero(mantissa);
  limbs_[0] = mantissa >> zeros;
  size_ = 1;
  sign_ = value > 0 ? 1 : -1;
  exponent_ = exponent - 53 + zeros;
}

void Dyadic::CopyFrom(const Dyadic& other) {
  size_ = other.size_;
  sign_ = other.sign_;
  exponent_ = other.exponent_;
  std::memcpy(limbs_, other.limbs_, static_cast<std::size_t>(size_) * sizeof(mp_limb_t));
}

void Dyadic::SetShifted(const Dyadic& value, long bits) {
  const long limbs = bits / kLimbBits;
  assert(value.size_ + limbs < kLimbs);
  size_ = value.size_ + static_cast<int>(limbs);
  std::memset(limbs_, 0, static_cast<std::size_t>(limbs) * sizeof(mp_limb_t));
  const auto rest = static_cast<unsigned>(bits % kLimbBits);
  if (rest == 0) {
    std::memcpy(limbs_ + limbs, value.limbs_,
                static_cast<std::size_t>(value.size_) * sizeof(mp_limb_t));
  } else {
    const mp_limb_t carry = mpn_lshift(limbs_ + limbs, value.limbs_, value.size_, rest);
    if (carry != 0) limbs_[size_++] = carry;
  }
}

void Dyadic::DropZeros() {
  while (size_ > 0 && limbs_[size_ - 1] == 0) --size_;
  if (size_ == 0) sign_ = 0;
}

long Dyadic::Bits() const {
  return long{size_} * kLimbBits - std::countl_zero(std::uint64_t{limbs_[size_ - 1]});
}

long Dyadic::Exponent() const { return exponent_ + Bits() - 1; }

Dyadic operator*(const Dyadic& a, const Dyadic& b) {
  Dyadic product;
  if (a.sign_ == 0 || b.sign_ == 0) return product;
  assert(a.size_ + b.size_ <= Dyadic::kLimbs);
  product.sign_ = a.sign_ * b.sign_;
  product.exponent_ = a.exponent_ + b.exponent_;
  product.size_ = a.size_ + b.size_;
  if (a.size_ == 1 && b.size_ == 1) {
    __extension__ using Wide = unsigned __int128;
    const Wide wide = static_cast<Wide>(a.limbs_[0]) * b.limbs_[0];
    product.limbs_[0] = static_cast<mp_limb_t>(wide);
    product.limbs_[1] = static_cast<mp_limb_t>(wide >> Dyadic::kLimbBits);
  } else if (a.size_ >= b.size_) {
    mpn_mul(product.limbs_, a.limbs_, a.size_, b.limbs_, b.size_);
  } else {
    mpn_mul(product.limbs_, b.limbs_, b.size_, a.limbs_, a.size_);
  }
  product.DropZeros();
  return product;
}

Dyadic Dyadic::Sum(const Dyadic& a, const Dyadic& b, int sign_of_b) {
  if (sign_of_b == 0) return a;
  if (a.sign_ == 0) {
    Dyadic sum(b);
    sum.sign_ = sign_of_b;
    return sum;
  }
  const bool a_is_low = a.exponent_ <= b.exponent_;
  const Dyadic& low = a_is_low ? a : b;
  const Dyadic& high = a_is_low ? b : a;
  const int sign_of_low = a_is_low ? a.sign_ : sign_of_b;
  const int sign_of_high = a_is_low ? sign_of_b : a.sign_;
  Dyadic sum;
  sum.SetShifted(high, high.exponent_ - low.exponent_);
  sum.exponent_ = low.exponent_;
  sum.sign_ = sign_of_high;
  const bool low_is_longer = low.size_ > sum.size_;
  if (sign_of_low == sign_of_high) {
    const mp_limb_t carry = low_is_longer
                                ? mpn_add(sum.limbs_, low.limbs_, low.size_, sum.limbs_, sum.size_)
                                : mpn_add(sum.limbs_, sum.limbs_, sum.size_, low.limbs_, low.size_);
    sum.size_ = std::max(sum.size_, low.size_);
    assert(sum.size_ < kLimbs);
    if (carry != 0) sum.limbs_[sum.size_++] = carry;
    return sum;
  }
  const bool low_is_larger =
      low_is_longer || (low.size_ == sum.size_ && mpn_cmp(low.limbs_, sum.limbs_, low.size_) > 0);
  if (low_is_larger) {
    mpn_sub(sum.limbs_, low.limbs_, low.size_, sum.limbs_, sum.size_);
    sum.size_ = low.size_;
    sum.sign_ = sign_of_low;
  } else {
    mpn_sub(sum.limbs_, sum.limbs_, sum.size_, low.limbs_, low.size_);
  }
  sum.DropZeros();
  return sum;
}

Dyadic Dyadic::Quotient(const Dyadic& numerator, const Dyadic& denominator, int exponent) {
  assert(denominator.sign_ != 0);
  Dyadic quotient;
  if (numerator.sign_ == 0) return quotient;
  // An integer quotient; the numerator or the denominator is shifted.
  const long shift = numerator.exponent_ - denominator.exponent_ - exponent;
  Dyadic n, d, rest;
  n.SetShifted(numerator, std::max(shift, 0L));
  d.SetShifted(denominator, std::max(-shift, 0L));
  if (n.size_ < d.size_) return quotient;
  mpn_tdiv_qr(quotient.limbs_, rest.limbs_, 0, n.limbs_, n.size_, d.limbs_, d.size_);
  quotient.size_ = n.size_ - d.size_ + 1;
  quotient.sign_ = numerator.sign_ * denominator.sign_;
  quotient.exponent_ = exponent;
  quotient.DropZeros();
  return quotient;
}

double Dyadic::Quotient(const Dyadic& numerator, const Dyadic& denominator) {
  assert(denominator.sign_ != 0);
  if (numerator.sign_ == 0) return 0;
  // A quotient of 55 or 56 bits: 53 for the result, two or three for rounding. The last bit is set
  // if any remainder is not 0.
  const long shift = 55 - (numerator.Bits() - denominator.Bits());
  Dyadic n, d, rest;
  n.SetShifted(numerator, std::max(shift, 0L));
  d.SetShifted(denominator, std::max(-shift, 0L));
  mp_limb_t quotient[2] = {};
  assert(n.size_ >= d.size_ && n.size_ - d.size_ <= 1);
  mpn_tdiv_qr(quotient, rest.limbs_, 0, n.limbs_, n.size_, d.limbs_, d.size_);
  std::uint64_t bits = quotient[0];
  for (int i = 0; i < d.size_; ++i) bits |= rest.limbs_[i] != 0 ? 1 : 0;
  const double magnitude = Round(bits, numerator.exponent_ - denominator.exponent_ - shift);
  return numerator.sign_ == denominator.sign_ ? magnitude : -magnitude;
}

}  // namespace kdray::core
