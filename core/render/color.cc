// SPDX-License-Identifier: Apache-2.0
#include "core/render/color.h"

#include <array>
#include <cmath>
#include <cstddef>

namespace kdray::core {
namespace {

double SrgbToLinear(double encoded) {
  return encoded <= 0.04045 ? encoded / 12.92 : std::pow((encoded + 0.055) / 1.055, 2.4);
}

// The inverse of the encoding: code c begins at the linear value of c - 1/2. A value's slot of
// 1/1024 gives a code at most a few below the right one, even at the steep dark end.
struct EncodingTable {
  static constexpr std::size_t kSlots = 1024;
  std::array<float, 257> begins{};
  std::array<std::uint8_t, kSlots + 1> first_code{};

  EncodingTable() {
    for (std::size_t code = 1; code < 256; ++code) {
      begins[code] = static_cast<float>(SrgbToLinear((static_cast<double>(code) - 0.5) / 255.0));
    }
    begins[256] = 2.0f;  // ends every search
    std::size_t code = 0;
    for (std::size_t slot = 0; slot <= kSlots; ++slot) {
      const float low = static_cast<float>(slot) / kSlots;
      while (begins[code + 1] <= low) ++code;
      first_code[slot] = static_cast<std::uint8_t>(code);
    }
  }
};

}  // namespace

float SrgbToLinear(float encoded) {
  return static_cast<float>(SrgbToLinear(static_cast<double>(encoded)));
}

Rgb SrgbToLinear(const Rgb& encoded) {
  return {SrgbToLinear(encoded.r), SrgbToLinear(encoded.g), SrgbToLinear(encoded.b)};
}

std::uint8_t LinearToSrgb8(float linear) {
  static const EncodingTable table;
  if (!(linear > 0.0f)) return 0;
  if (linear >= 1.0f) return 255;
  std::size_t code = table.first_code[static_cast<std::size_t>(linear * EncodingTable::kSlots)];
  while (linear >= table.begins[code + 1]) ++code;
  return static_cast<std::uint8_t>(code);
}

std::uint8_t ToUnorm8(float value) {
  if (!(value > 0.0f)) return 0;
  if (value >= 1.0f) return 255;
  return static_cast<std::uint8_t>(value * 255.0f + 0.5f);
}

}  // namespace kdray::core
