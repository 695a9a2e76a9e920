// SPDX-License-Identifier: Apache-2.0
// Converts a rendered image to an 8-bit sRGB picture.
#pragma once

#include <cstdint>
#include <vector>

#include "core/base/cancel.h"
#include "core/base/result.h"
#include "core/render/renderer.h"

namespace kdray::core {

/// Row-major [height][width][channels], top row first. 3 channels: red, green, blue; 4: also alpha,
/// not premultiplied, as in PNG.
struct Picture {
  int width = 0, height = 0, channels = 3;
  std::vector<std::uint8_t> pixels;
  friend bool operator==(const Picture&, const Picture&) = default;
};

/// 4 channels when the background is transparent, else 3.
///   kShaded    sRGB-encoded.
///   kNormal    (n + 1) / 2 as codes 0..255, not sRGB-encoded, over the background.
///   kDepth     grey, lighter when nearer (GreyOf, with image.depth_range; without one, the range
///              of the image's own hits).
///   kAmbientOcclusion  grey, sRGB-encoded.
///   kTriangle  a colour by number (HashedColor).
///   kCost      a colour by the work (HeatColor); no work counts as a miss.
/// Pixels that miss show the background. kPosition has no picture: the background. Lines of
/// edges and cells are drawn over everything. A region's picture equals its part of the whole
/// picture; of kDepth, if depth_range is that of the whole image (RangeOfWholeImage). O(pixels), in
/// parallel within the caller's arena. Errors: kCancelled, kDeadlineExceeded.
Result<Picture> MakePicture(const RenderedImage& image, const CancelToken& cancel);
/// The same; RenderedImage::codes are moved.
Result<Picture> MakePicture(RenderedImage&& image, const CancelToken& cancel);
/// The same without cancellation.
Picture MakePicture(const RenderedImage& image);

}  // namespace kdray::core
