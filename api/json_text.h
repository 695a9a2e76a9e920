// SPDX-License-Identifier: Apache-2.0
// Writes JSON text directly, for answers of millions of numbers.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace kdray::api {

/// Appends the shortest text that reads back as the same number; `null` for a number that is not
/// finite.
void AppendNumber(std::string* out, double value);
void AppendNumber(std::string* out, float value);
std::string NumberText(double value);
void AppendInteger(std::string* out, std::int64_t value);

/// `"invalid":[…],"truncated":[…]`, the end of every batch answer.
void AppendRowLists(std::string* out, const std::vector<std::uint64_t>& invalid,
                    const std::vector<std::uint64_t>& truncated);

// The same into memory that is large enough; each returns the end of its text.
inline constexpr std::size_t kMostNumberBytes = 24;  ///< -2.2250738585072014e-308
char* PutNumber(char* out, double value);
char* PutNumber(char* out, float value);
char* PutInteger(char* out, std::int64_t value);
inline char* PutWord(char* out, std::string_view word) {
  return std::copy(word.begin(), word.end(), out);
}

}  // namespace kdray::api
