// SPDX-License-Identifier: Apache-2.0
#include "api/json_rows.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <charconv>
#include <cmath>
#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <memory>
#include <string>
#include <vector>

namespace kdray::api {
namespace {

// A part of the text is about this long: some tenths of a millisecond.
constexpr std::size_t kPartBytes = 128 * 1024;
// Longer runs of blanks and longer numbers are not plain. They are left to the other reader, which
// looks at `should_stop` within them.
constexpr std::ptrdiff_t kMostBlanks = 4096;
constexpr std::ptrdiff_t kMostDigits = 1024;

constexpr std::array<double, 23> kPowersOfTen = {1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,
                                                 1e8,  1e9,  1e10, 1e11, 1e12, 1e13, 1e14, 1e15,
                                                 1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22};

bool IsBlank(char c) { return c == ' ' || c == '\n' || c == '\r' || c == '\t'; }
bool IsDigit(char c) { return c >= '0' && c <= '9'; }

/// A position in a text whose last character is a bracket, at which every loop here stops. After a
/// failure it is null.
using At = const char*;

At SkipBlanks(At at) {
  if (!IsBlank(*at)) return at;
  const At from = at;
  while (IsBlank(*at)) ++at;
  return at - from <= kMostBlanks ? at : nullptr;
}

/// The text of a number as the decimal `mantissa` * 10^`exponent`.
struct Decimal {
  std::uint64_t mantissa = 0;
  int exponent = 0;
  std::ptrdiff_t digits = 0;  ///< beyond 19 the mantissa has overflowed
};

At ReadDigits(At at, Decimal* decimal) {
  const At from = at;
  for (; IsDigit(*at); ++at) {
    decimal->mantissa = 10 * decimal->mantissa + static_cast<std::uint64_t>(*at - '0');
  }
  decimal->digits += at - from;
  return at;
}

/// std::from_chars, with 0 and the subnormal numbers for what is nearest to them. False beyond the
/// range of double.
bool ReadNearest(At from, At to, double* value) {
  const std::from_chars_result read = std::from_chars(from, to, *value);
  if (read.ec == std::errc()) return read.ptr == to;
  // Too large, or so small that from_chars does not say which number is nearest.
  *value = std::strtod(std::string(from, to).c_str(), nullptr);
  return std::isfinite(*value);
}

/// A number by the grammar of JSON (RFC 8259, 6), to the nearest double.
At ReadNumber(At from, double* value) {
  const bool negative = *from == '-';
  At at = from + (negative ? 1 : 0);
  if (!IsDigit(*at) || (*at == '0' && IsDigit(at[1]))) return nullptr;
  Decimal decimal;
  at = ReadDigits(at, &decimal);
  if (*at == '.') {
    const At point = at;
    at = ReadDigits(at + 1, &decimal);
    if (at == point + 1) return nullptr;
    decimal.exponent = static_cast<int>(point + 1 - at);
  }
  bool has_exponent = false;
  if (*at == 'e' || *at == 'E') {
    has_exponent = true;
    ++at;
    if (*at == '+' || *at == '-') ++at;
    if (!IsDigit(*at)) return nullptr;
    while (IsDigit(*at)) ++at;
  }
  if (at - from > kMostDigits) return nullptr;
  // Both factors are exact doubles, so the one rounding is to the nearest (Clinger, "How to Read
  // Floating Point Numbers Accurately", PLDI 1990).
  if (!has_exponent && decimal.digits <= 19 && decimal.mantissa <= std::uint64_t{1} << 53 &&
      decimal.exponent >= -22) {
    const double magnitude = static_cast<double>(decimal.mantissa) /
                             kPowersOfTen[static_cast<std::size_t>(-decimal.exponent)];
    *value = negative ? -magnitude : magnitude;
    return at;
  }
  return ReadNearest(from, at, value) ? at : nullptr;
}

/// The rows of a batch, cut into parts.
class PlainRows {
 public:
  PlainRows(double t_min, double t_max) : t_min_(t_min), t_max_(t_max) {}

  /// Finds the list of rows within the text. False if the text has another form.
  bool Find(std::string_view text) {
    if (!TakeBlanks(&text) || !Take(&text, "{") || !TakeBlanks(&text) || !Take(&text, "\"rays\"") ||
        !TakeBlanks(&text) || !Take(&text, ":") || !TakeBlanks(&text) || !Take(&text, "[")) {
      return false;
    }
    for (const char* bracket : {"}", "]"}) {
      if (!DropBlanks(&text) || !text.ends_with(bracket)) return false;
      text.remove_suffix(1);
    }
    if (!TakeBlanks(&text) || !DropBlanks(&text)) return false;
    if (!text.empty() && text.back() != ']') return false;
    list_ = text;
    return true;
  }

  /// Cuts the list after rows.
  void Cut() {
    for (std::size_t at = 0; at < list_.size();) {
      const std::size_t close = list_.find(']', std::min(at + kPartBytes, list_.size() - 1));
      parts_.push_back({list_.substr(at, close + 1 - at), 0});
      at = close + 1;
    }
  }
  std::size_t parts() const { return parts_.size(); }

  /// Counts the rows of a part.
  void Count(std::size_t part) {
    std::string_view text = parts_[part].text;
    for (std::size_t close; (close = text.find(']')) != std::string_view::npos;) {
      ++parts_[part].rows;
      text.remove_prefix(close + 1);
    }
  }
  /// Sums the counts. Returns the number of all rows.
  std::size_t Number() {
    std::size_t rows = 0;
    for (Part& part : parts_) {
      part.first_row = rows;
      rows += part.rows;
    }
    return rows;
  }

  /// Reads a part's rows to their place in `numbers`. False if the part has another form.
  bool Read(std::size_t part, double* numbers) const {
    const std::string_view text = parts_[part].text;
    double* out = numbers + parts_[part].first_row * kRayNumbers;
    At at = text.data();
    const At end = at + text.size();
    for (bool is_first = part == 0; at != end; is_first = false) {
      if (!is_first) {
        at = SkipBlanks(at);
        if (at == nullptr || *at++ != ',') return false;
        at = SkipBlanks(at);
        if (at == nullptr) return false;
      }
      at = ReadRow(at, out);
      if (at == nullptr) return false;
      out += kRayNumbers;
    }
    return true;
  }

 private:
  struct Part {
    std::string_view text;  ///< its last character closes a row
    std::size_t rows = 0, first_row = 0;
  };

  static bool Take(std::string_view* text, std::string_view word) {
    if (!text->starts_with(word)) return false;
    text->remove_prefix(word.size());
    return true;
  }
  static bool TakeBlanks(std::string_view* text) {
    std::size_t blanks = 0;
    while (blanks < text->size() && IsBlank((*text)[blanks])) ++blanks;
    text->remove_prefix(blanks);
    return blanks <= kMostBlanks;
  }
  static bool DropBlanks(std::string_view* text) {
    std::size_t blanks = 0;
    for (; !text->empty() && IsBlank(text->back()); ++blanks) text->remove_suffix(1);
    return blanks <= kMostBlanks;
  }

  At ReadRow(At at, double* out) const {
    if (*at++ != '[') return nullptr;
    double n[kRayNumbers];
    for (std::size_t column = 0; column < kRayNumbers; ++column) {
      at = SkipBlanks(at);
      if (at == nullptr) return nullptr;
      if (*at == 'n' && column == 7) {
        // A bracket ends the text, so the comparison ends within it.
        if (std::strncmp(at, "null", 4) != 0) return nullptr;
        n[column] = std::numeric_limits<double>::infinity();
        at += 4;
      } else {
        at = ReadNumber(at, &n[column]);
        if (at == nullptr) return nullptr;
      }
      at = SkipBlanks(at);
      if (at == nullptr) return nullptr;
      if (*at == ']') {
        if (column != 5 && column != 7) return nullptr;
        const bool with_interval = column == 7;
        const double row[kRayNumbers] = {n[0], n[1], n[2], with_interval ? n[6] : t_min_,
                                         n[3], n[4], n[5], with_interval ? n[7] : t_max_};
        std::copy(row, row + kRayNumbers, out);
        return at + 1;
      }
      if (*at++ != ',') return nullptr;
    }
    return nullptr;
  }

  const double t_min_, t_max_;
  std::string_view list_;
  std::vector<Part> parts_;
};

void Run(const BatchWork& work, std::size_t count, const std::function<void(std::size_t)>& piece) {
  if (work.run) {
    work.run(count, piece);
  } else {
    for (std::size_t i = 0; i < count; ++i) piece(i);
  }
}

}  // namespace

Outcome<std::optional<RayTable>> ReadPlainRays(std::string_view json, double t_min, double t_max,
                                               std::uint64_t max_rows, const BatchWork& work) {
  const auto other_form = [] { return std::optional<RayTable>(); };
  PlainRows rows(t_min, t_max);
  if (!rows.Find(json)) return other_form();
  rows.Cut();
  Run(work, rows.parts(), [&](std::size_t part) { rows.Count(part); });
  const std::size_t count = rows.Number();
  if (count > max_rows) return other_form();
  if (work.charge) {
    if (Check problem = work.charge(count * kRayNumbers * sizeof(double))) {
      return *std::move(problem);
    }
  }
  auto numbers = std::make_unique_for_overwrite<double[]>(count * kRayNumbers);
  std::atomic<bool> failed{false};
  Run(work, rows.parts(), [&](std::size_t part) {
    if (failed.load(std::memory_order_relaxed)) return;
    const bool stop = work.should_stop && work.should_stop();
    if (stop || !rows.Read(part, numbers.get())) failed = true;
  });
  if (failed) return other_form();
  return std::optional<RayTable>(RayTable(std::move(numbers), count));
}

}  // namespace kdray::api
