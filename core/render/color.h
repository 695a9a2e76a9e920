// SPDX-License-Identifier: Apache-2.0
// Colours: sRGB as callers write them, linear light as the renderer adds them up.
#pragma once

#include <cstdint>

namespace kdray::core {

/// Red, green, blue in 0..1. Each declaration says whether it is sRGB-encoded or linear.
struct Rgb {
  float r = 0, g = 0, b = 0;
  friend bool operator==(const Rgb&, const Rgb&) = default;
};

/// Linear light with coverage, premultiplied: r, g, b are already weighted by a, so samples and
/// layers add up without a special case for transparent ones.
struct Rgba {
  float r = 0, g = 0, b = 0, a = 0;
  friend bool operator==(const Rgba&, const Rgba&) = default;
};

/// `over` in front of `under`.
inline Rgba Over(const Rgba& over, const Rgba& under) {
  const float rest = 1.0f - over.a;
  return {over.r + rest * under.r, over.g + rest * under.g, over.b + rest * under.b,
          over.a + rest * under.a};
}
inline Rgba operator*(const Rgba& c, float s) { return {c.r * s, c.g * s, c.b * s, c.a * s}; }

/// IEC 61966-2-1, piecewise, on one channel in 0..1.
float SrgbToLinear(float encoded);
Rgb SrgbToLinear(const Rgb& encoded);

/// The 8-bit sRGB code nearest to a linear value; values outside 0..1 are clamped, NaN gives 0. A
/// table lookup, because it runs for every channel of every pixel.
std::uint8_t LinearToSrgb8(float linear);

/// round(255 * value), clamped; NaN gives 0. For numbers that are not light: alpha, normals.
std::uint8_t ToUnorm8(float value);

}  // namespace kdray::core
