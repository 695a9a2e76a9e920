// SPDX-License-Identifier: Apache-2.0
#include "core/render/color.h"

#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "core/render/srgb_codes.h"

namespace kdray::core {
namespace {

double SrgbToLinear(double encoded) {
  return encoded <= 0.04045 ? encoded / 12.92 : std::pow((encoded + 0.055) / 1.055, 2.4);
}

}  // namespace

float SrgbToLinear(float encoded) {
  return static_cast<float>(SrgbToLinear(static_cast<double>(encoded)));
}

Rgb SrgbToLinear(const Rgb& encoded) {
  return {SrgbToLinear(encoded.r), SrgbToLinear(encoded.g), SrgbToLinear(encoded.b)};
}

SrgbCodes::SrgbCodes() {
  std::array<float, 257> begins{};
  for (std::size_t code = 1; code < 256; ++code) {
    begins[code] = static_cast<float>(SrgbToLinear((static_cast<double>(code) - 0.5) / 255.0));
  }
  begins[256] = 2.0f;  // ends the search
  std::uint32_t code = 0;
  for (std::uint32_t slot = 0; slot < slots_.size(); ++slot) {
    const auto low = std::bit_cast<float>((kFirst + slot) << kShift);
    while (begins[code + 1] <= low) ++code;
    const auto next = std::bit_cast<std::uint32_t>(begins[code + 1]);
    const bool begins_here = next >> kShift == kFirst + slot;
    slots_[slot] = begins_here ? ((code + 1) << kShift) - (next & kLow) : code << kShift;
  }
}

const SrgbCodes& SrgbCodes::Table() {
  static const SrgbCodes table;
  return table;
}

std::uint8_t LinearToSrgb8(float linear) { return SrgbCodes::Table()(linear); }

std::uint8_t ToUnorm8(float value) {
  if (!(value > 0.0f)) return 0;
  if (value >= 1.0f) return 255;
  return static_cast<std::uint8_t>(value * 255.0f + 0.5f);
}

}  // namespace kdray::core
