// SPDX-License-Identifier: Apache-2.0
// Decodes PNG files, with another library than the one that writes them, and compares golden
// pictures.
#pragma once

#include <gtest/gtest.h>

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace kdray::test {

/// Row-major, top row first; 3 channels (RGB) or 4 (RGBA, not premultiplied).
struct Image {
  int width = 0, height = 0, channels = 3;
  std::vector<std::uint8_t> pixels;
  friend bool operator==(const Image&, const Image&) = default;
};

/// Throws std::runtime_error if the bytes are not a PNG.
Image DecodePng(std::span<const std::byte> png);

/// The allowed difference from a golden picture, in 8-bit codes. Mathematical functions of machines
/// differ in the last bits, which changes codes by one and sometimes moves a sample across an edge.
struct GoldenTolerance {
  int code = 2;                ///< pixels whose channels differ by at most this count as equal
  double pixel_share = 0.001;  ///< share of pixels that may differ by more
};

/// Success when `png` shows tests/golden/<name>.png within the tolerance. Otherwise the failure
/// names three files: the golden one, and <name>.actual.png and <name>.difference.png (each
/// channel's difference, eight times) in the folder `golden` of the build. With KDRAY_UPDATE_GOLDEN
/// set to 1, writes the golden file instead.
testing::AssertionResult MatchesGolden(std::string_view name, std::span<const std::byte> png,
                                       const GoldenTolerance& tolerance = {});

}  // namespace kdray::test
