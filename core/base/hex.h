// SPDX-License-Identifier: Apache-2.0
// Bytes as hexadecimal digits.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace kdray::core {

/// Appends the byte as two lower-case digits.
inline void AppendHex(std::uint8_t byte, std::string* text) {
  constexpr std::string_view kDigits = "0123456789abcdef";
  text->push_back(kDigits[byte >> 4]);
  text->push_back(kDigits[byte & 15]);
}

}  // namespace kdray::core
