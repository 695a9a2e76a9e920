// SPDX-License-Identifier: Apache-2.0
#include "core/io/printed_float.h"

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>

namespace kdray::core {
namespace {

bool IsDigit(char c) { return c >= '0' && c <= '9'; }

/// A decimal number taken apart: +- 0.d1 d2 d3... * 10^exponent, from the first digit that is not 0
/// to the last that is written.
struct Decimal {
  std::string_view digits;  ///< with a point among them, perhaps
  std::size_t count = 0;    ///< of the digits; 0 when all are 0
  std::int64_t last = 0;    ///< power of ten of the last digit
  bool has_exponent = false;
};

Decimal TakeApart(std::string_view word) {
  std::size_t i = !word.empty() && (word[0] == '-' || word[0] == '+') ? 1 : 0;
  Decimal decimal;
  std::size_t begin = std::string_view::npos;
  bool point = false;
  for (; i < word.size() && (IsDigit(word[i]) || word[i] == '.'); ++i) {
    if (word[i] == '.') {
      point = true;
      continue;
    }
    if (point) --decimal.last;
    if (begin == std::string_view::npos && word[i] != '0') begin = i;
    if (begin != std::string_view::npos) ++decimal.count;
  }
  if (begin != std::string_view::npos) decimal.digits = word.substr(begin, i - begin);
  if (i < word.size()) {
    decimal.has_exponent = true;
    ++i;  // the e
    if (i < word.size() && word[i] == '+') ++i;
    std::int64_t exponent = 0;
    std::from_chars(word.data() + i, word.data() + word.size(), exponent);
    decimal.last += exponent;
  }
  return decimal;
}

// The digits without the point, at most `most`; empty if a cut-off digit is not 0.
std::string Digits(std::string_view with_point, std::size_t most) {
  std::string digits;
  for (const char c : with_point) {
    if (c == '.') continue;
    if (digits.size() < most) {
      digits += c;
    } else if (c != '0') {
      return {};
    }
  }
  return digits;
}

// No float has more digits: this many show it exactly.
constexpr std::size_t kMostDigits = 120;

// The digits of |value|, rounded to `count` of them, and the power of ten of the last.
struct Printed {
  std::string digits;
  std::int64_t last = 0;
};
Printed Print(float value, std::size_t count) {
  std::array<char, kMostDigits + 16> text;
  const auto end =
      std::to_chars(text.data(), text.data() + text.size(), static_cast<double>(std::fabs(value)),
                    std::chars_format::scientific, static_cast<int>(count) - 1)
          .ptr;
  const Decimal decimal = TakeApart({text.data(), static_cast<std::size_t>(end - text.data())});
  return {Digits(decimal.digits, kMostDigits), decimal.last};
}

bool GivesBack(float value, const Decimal& decimal) {
  const std::size_t count = std::min(decimal.count, kMostDigits);
  const std::string wanted = Digits(decimal.digits, count);
  if (wanted.empty()) return false;
  const std::int64_t last = decimal.last + static_cast<std::int64_t>(decimal.count - count);
  Printed printed = Print(value, count);
  // Just below a power of ten the float has one digit less before the last place. With an exponent,
  // digits are counted, not places.
  const bool by_places = !decimal.has_exponent;
  if (by_places && printed.last == last - 1 && count > 1) printed = Print(value, count - 1);
  if (printed.digits.size() + 1 == count && printed.last == last + 1) printed.digits += '0';
  return printed.digits == wanted && (printed.last == last || printed.last == last + 1);
}

constexpr std::int64_t kLargestPower = 60;

double HalfPowerOfTen(std::int64_t exponent) {
  static const std::array<double, 2 * kLargestPower + 1> kPowers = [] {
    std::array<double, 2 * kLargestPower + 1> powers{};
    for (std::int64_t i = -kLargestPower; i <= kLargestPower; ++i) {
      const std::string text = "0.5e" + std::to_string(i);
      std::from_chars(text.data(), text.data() + text.size(),
                      powers[static_cast<std::size_t>(i + kLargestPower)]);
    }
    return powers;
  }();
  return kPowers[static_cast<std::size_t>(exponent + kLargestPower)];
}

// The float nearest to the text. `value` is the nearest double; the text can be nearer to one float
// than to the other only if that double lies halfway between them.
float NearestFloat(std::string_view word, double value) {
  constexpr std::uint64_t kCutOff = (std::uint64_t{1} << 29) - 1;
  constexpr std::uint64_t kHalf = std::uint64_t{1} << 28;
  const bool ordinary = std::fabs(value) >= static_cast<double>(std::numeric_limits<float>::min());
  if (ordinary && (std::bit_cast<std::uint64_t>(value) & kCutOff) != kHalf) {
    return static_cast<float>(value);
  }
  if (word.starts_with('+')) word.remove_prefix(1);
  auto nearest = static_cast<float>(value);
  float parsed = 0;
  if (std::from_chars(word.data(), word.data() + word.size(), parsed).ec == std::errc()) {
    nearest = parsed;
  }
  return nearest;
}

}  // namespace

std::optional<float> ParsePrintedFloat(std::string_view word, double value) {
  const double size = std::fabs(value);
  if (!std::isfinite(value)) {
    const bool as_word = word.find_first_of("nN") != std::string_view::npos;
    return as_word ? std::optional(static_cast<float>(value)) : std::nullopt;
  }
  if (size > static_cast<double>(std::numeric_limits<float>::max())) return std::nullopt;
  constexpr std::size_t kAlwaysExact = std::numeric_limits<float>::digits10;
  const bool ordinary = size >= static_cast<double>(std::numeric_limits<float>::min());
  const float nearest = NearestFloat(word, value);
  // Every float in the normal range preserves six digits.
  if (ordinary && word.size() <= kAlwaysExact) return nearest;
  const Decimal decimal = TakeApart(word);
  if (decimal.count == 0) return nearest;
  if (ordinary && decimal.count <= kAlwaysExact) return nearest;

  // `value` differs from the text by 2^-53 of its size, far less than a unit of the text's last
  // place with up to 14 digits. Numbers too close to half a unit are decided by printing.
  if (ordinary && decimal.count <= 14 && std::abs(decimal.last) <= kLargestPower) {
    const double off = std::fabs(static_cast<double>(nearest) - value);
    const double half = HalfPowerOfTen(decimal.last);
    const double doubt = 0x1p-52 * size + 0x1p-50 * half;
    const bool may_gain_digit = decimal.has_exponent && decimal.digits.front() == '1' &&
                                std::fabs(static_cast<double>(nearest)) < size;
    if (off < half - doubt && !may_gain_digit) return nearest;
    if (off > half + doubt) return std::nullopt;
  }
  return GivesBack(nearest, decimal) ? std::optional(nearest) : std::nullopt;
}

}  // namespace kdray::core
