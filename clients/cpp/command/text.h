// Numbers as people read them.
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

/// Up to `digits` significant digits, without zeros behind: 0.15555 -> "0.1556".
std::string NumberText(double number, int digits = 4);

/// Columns as wide as their widest cell, two blanks between them. `alignment` has a letter a
/// column: 'l' or 'r'. Every row has as many cells as the first.
std::string Table(const std::vector<std::vector<std::string>>& rows, std::string_view alignment);

}  // namespace kdray::client
