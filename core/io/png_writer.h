// SPDX-License-Identifier: Apache-2.0
// Encodes pixels as PNG. Only its .cc includes the libraries for compression.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/base/cancel.h"
#include "core/base/result.h"

namespace kdray::core {

inline constexpr int kMaxPngSide = 16384;

/// A PNG file of 8-bit pixels: row-major [height][width][channels], top row first; channels 1 grey,
/// 2 grey and alpha, 3 RGB, 4 RGBA; alpha not premultiplied; sRGB is assumed by readers. The same
/// pixels always give the same bytes. kInvalidArgument when a side is not in 1..kMaxPngSide, the
/// number of pixels does not match the sides, or they are 2^30 bytes or more; kMemoryFull when
/// memory runs out; kCancelled, kDeadlineExceeded. O(pixels); large pictures in parallel within the
/// caller's arena. Safe from many threads at once.
Result<std::vector<std::byte>> EncodePng(std::span<const std::uint8_t> pixels, int width,
                                         int height, int channels, const CancelToken& cancel = {});

}  // namespace kdray::core
