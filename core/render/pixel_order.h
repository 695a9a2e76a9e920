// SPDX-License-Identifier: Apache-2.0
// The order in which a tile's pixels are traced.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace kdray::core {

/// Calls f(x, y) for the pixels of a tile of width x height, in blocks of 8 x 8, each along a Z
/// curve (Morton 1966): so any 4, 16 or 64 rays in a row are close in both directions, and the
/// kernels take them as a packet.
template <class F>
void ForEachInPixelOrder(int width, int height, const F& f) {
  constexpr int kSide = 8;
  struct Place {
    int x, y;
  };
  static constexpr auto kCurve = [] {
    const auto spread = [](int x) { return (x & 1) | (x & 2) << 1 | (x & 4) << 2; };
    std::array<Place, kSide * kSide> curve{};
    for (int y = 0; y < kSide; ++y) {
      for (int x = 0; x < kSide; ++x) {
        curve[static_cast<std::size_t>(spread(x) | spread(y) << 1)] = {x, y};
      }
    }
    return curve;
  }();
  for (int top = 0; top < height; top += kSide) {
    for (int left = 0; left < width; left += kSide) {
      for (const auto& [dx, dy] : kCurve) {
        if (left + dx < width && top + dy < height) f(left + dx, top + dy);
      }
    }
  }
}

/// The positions of these pixels, row by row.
inline std::vector<std::uint32_t> PixelOrder(int width, int height) {
  std::vector<std::uint32_t> order;
  order.reserve(static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  ForEachInPixelOrder(width, height, [&](int x, int y) {
    order.push_back(static_cast<std::uint32_t>(y * width + x));
  });
  return order;
}

}  // namespace kdray::core
