// SPDX-License-Identifier: Apache-2.0
// The table that encodes linear light as 8-bit sRGB, for loops over many values.
#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>

#include "core/render/color.h"

namespace kdray::core {

/// LinearToSrgb8() (core/render/color.h) without a call and without a branch. Code c begins at the
/// linear value of c - 1/2. A slot of the table has the floats with the same upper 16 bits, 128
/// slots between two powers of two. At most one code begins in a slot, so its place among the lower
/// 16 bits, subtracted from the code, makes an addition carry exactly from there on.
class SrgbCodes {
 public:
  static const SrgbCodes& Table();

  std::uint8_t operator()(float linear) const {
    float clamped = linear > kSmallest ? linear : kSmallest;  // NaN too
    clamped = clamped < kLargest ? clamped : kLargest;
    const auto bits = std::bit_cast<std::uint32_t>(clamped);
    return static_cast<std::uint8_t>((slots_[(bits >> kShift) - kFirst] + (bits & kLow)) >> kShift);
  }

 private:
  static constexpr int kShift = 16;
  static constexpr std::uint32_t kLow = (1u << kShift) - 1;
  static constexpr float kSmallest = 0x1p-13f;       // code 1 begins above it
  static constexpr float kLargest = 0x1.fffffep-1f;  // the float before 1; code 255 begins below it
  static constexpr std::uint32_t kFirst = std::bit_cast<std::uint32_t>(kSmallest) >> kShift;
  static constexpr std::uint32_t kEnd = (std::bit_cast<std::uint32_t>(kLargest) >> kShift) + 1;

  SrgbCodes();

  // 2^16 times the code of the slot's last float, minus the lower bits of the first one that has
  // it; 2^16 times the code where the whole slot has one.
  std::array<std::uint32_t, kEnd - kFirst> slots_{};
};

/// The 8-bit pixel of light, which is premultiplied red, green, blue and coverage; out has
/// kChannels, 3 or 4, the fourth is the coverage.
template <std::size_t kChannels>
void EncodeLight(const SrgbCodes& code_of, const float* light, std::uint8_t* out) {
  const float alpha = light[3];
  const float unpremultiply = alpha == 1.0f ? 1.0f : alpha > 0.0f ? 1.0f / alpha : 0.0f;
  for (std::size_t k = 0; k < 3; ++k) out[k] = code_of(light[k] * unpremultiply);
  if constexpr (kChannels == 4) out[3] = ToUnorm8(alpha);
}

}  // namespace kdray::core
