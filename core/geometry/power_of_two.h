// SPDX-License-Identifier: Apache-2.0
// Exact scaling by powers of two; a multiplication instead of std::ldexp where both give the same.
#pragma once

#include <bit>
#include <cmath>
#include <cstdint>

namespace kdray::core {

/// 2^exponent for -1022 <= exponent <= 1023.
inline double PowerOfTwo(int exponent) {
  return std::bit_cast<double>(static_cast<std::uint64_t>(exponent + 1023) << 52);
}

/// value * 2^exponent. Exact, except for overflow to infinity and for rounding of results below
/// 2^-1022.
inline double ScaleByPowerOfTwo(double value, int exponent) {
  if (exponent >= -1022 && exponent <= 1023) return value * PowerOfTwo(exponent);
  return std::ldexp(value, exponent);
}

}  // namespace kdray::core
