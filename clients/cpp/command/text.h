// Formats numbers for people.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace kdray::client {

/// 69451 -> "69,451".
std::string CountText(std::uint64_t count);

/// 3033195 -> "2.9 MiB".
std::string ByteText(double bytes);

/// Up to `digits` significant digits, without trailing zeros: 0.15555 -> "0.1556".
std::string NumberText(double number, int digits = 4);

/// "x y z", with six significant digits.
std::string VectorText(const std::vector<double>& numbers);

/// Columns as wide as their widest cell, separated by two blanks. `alignment` has one letter per
/// column: 'l' or 'r'. All rows have the same number of cells.
std::string Table(const std::vector<std::vector<std::string>>& rows, std::string_view alignment);

}  // namespace kdray::client
