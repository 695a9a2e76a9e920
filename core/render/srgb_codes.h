// SPDX-License-Identifier: Apache-2.0
// The table that encodes linear light as 8-bit sRGB, for loops over many values.
#pragma once

#include <array>
#include <bit>
#include <cstdint>

namespace kdray::core {

/// LinearToSrgb8() (core/render/color.h) without a call and without a branch. Code c begins at the
/// linear value of c - 1/2. A slot of the table has the floats with the same upper 16 bits, 128
/// slots between two powers of two. At most one code begins in a slot, so one comparison finds it.
class SrgbCodes {
 public:
  static const SrgbCodes& Table();

  std::uint8_t operator()(float linear) const {
    float clamped = linear > kSmallest ? linear : kSmallest;  // NaN too
    clamped = clamped < kLargest ? clamped : kLargest;
    const Slot& slot = slots_[(std::bit_cast<std::uint32_t>(clamped) >> kShift) - kFirst];
    return static_cast<std::uint8_t>(slot.code + (clamped >= slot.next_begin ? 1 : 0));
  }

 private:
  static constexpr int kShift = 16;
  static constexpr float kSmallest = 0x1p-13f;       // code 1 begins above it
  static constexpr float kLargest = 0x1.fffffep-1f;  // the float before 1; code 255 begins below it
  static constexpr std::uint32_t kFirst = std::bit_cast<std::uint32_t>(kSmallest) >> kShift;
  static constexpr std::uint32_t kEnd = (std::bit_cast<std::uint32_t>(kLargest) >> kShift) + 1;
  struct Slot {
    float next_begin;
    std::uint32_t code;
  };

  SrgbCodes();

  std::array<Slot, kEnd - kFirst> slots_{};
};

}  // namespace kdray::core
