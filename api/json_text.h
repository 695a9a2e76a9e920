// Writes JSON text directly, for answers of millions of numbers.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace kdray::api {

/// Appends the shortest text that reads back as the same number; `null` for a number that is not
/// finite.
void AppendNumber(std::string* out, double value);
void AppendNumber(std::string* out, float value);
std::string NumberText(double value);
void AppendInteger(std::string* out, std::int64_t value);

/// `"invalid":[…],"truncated":[]`, the end of every batch answer.
void AppendRowLists(std::string* out, const std::vector<std::uint64_t>& invalid);

}  // namespace kdray::api
