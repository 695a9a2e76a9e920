// SPDX-License-Identifier: Apache-2.0
// Formats numbers for people.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace kdray::client {

/// 69451 -> "69,451".
std::string CountText(std::uint64_t count);

/// (1, "rays") -> "1 ray", (5000, "invalid rows") -> "5,000 invalid rows". @pre `plural` ends in s.
std::string CountedText(std::uint64_t count, std::string plural);

/// 3033195 -> "2.9 MiB".
std::string ByteText(double bytes);

/// Up to `digits` significant digits, without trailing zeros: 0.15555 -> "0.1556". Numbers from
/// 10,000 to 1e15 are whole and grouped: 12345.6 -> "12,346".
std::string NumberText(double number, int digits = 4);

/// A duration in the unit that a person would choose, with three digits: "0.45 ms", "12.5 ms",
/// "312 ms", "10.1 s", "2 min 5 s", "3 h 20 min".
std::string DurationText(double milliseconds);

/// A rate or a large number with three digits: "950", "12.3 k", "2.10 M", "1.20 G".
std::string ShortText(double number);

/// "x y z", with six significant digits.
std::string VectorText(const std::vector<double>& numbers);

/// Columns as wide as their widest cell, separated by two blanks. `alignment` has one letter per
/// column: 'l' or 'r'. All rows have the same number of cells.
std::string Table(const std::vector<std::vector<std::string>>& rows, std::string_view alignment);

/// A table of at most `width` columns of characters. One that is wider becomes several tables, each
/// of which begins with the first `keys` columns. A `width` of 0 is unlimited.
std::string FittedTable(const std::vector<std::vector<std::string>>& rows,
                        std::string_view alignment, std::size_t width, std::size_t keys);

/// `text` without its end where it is longer than `width` characters (UTF-8).
std::string Shortened(std::string_view text, std::size_t width);

}  // namespace kdray::client
