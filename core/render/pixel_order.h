// SPDX-License-Identifier: Apache-2.0
// The order in which a tile's pixels are traced.
#pragma once

#include <cstdint>
#include <utility>
#include <vector>

namespace kdray::core {

/// The positions, row by row, of the pixels of a tile of width x height, in blocks of 8 x 8, each
/// along a Z curve (Morton 1966): so any 4, 16 or 64 rays in a row are close in both directions,
/// and the kernels take them as a packet.
inline std::vector<std::uint32_t> PixelOrder(int width, int height) {
  constexpr int kSide = 8;
  const auto spread = [](int x) { return (x & 1) | (x & 2) << 1 | (x & 4) << 2; };
  std::pair<int, int> curve[kSide * kSide];
  for (int y = 0; y < kSide; ++y) {
    for (int x = 0; x < kSide; ++x) curve[spread(x) | spread(y) << 1] = {x, y};
  }
  std::vector<std::uint32_t> order;
  order.reserve(static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  for (int top = 0; top < height; top += kSide) {
    for (int left = 0; left < width; left += kSide) {
      for (const auto& [dx, dy] : curve) {
        const int x = left + dx;
        const int y = top + dy;
        if (x < width && y < height) order.push_back(static_cast<std::uint32_t>(y * width + x));
      }
    }
  }
  return order;
}

}  // namespace kdray::core
