// SPDX-License-Identifier: Apache-2.0
// The pixel store and the pieces that are rendered one at a time.
#pragma once

#include <algorithm>
#include <cstddef>
#include <span>
#include <utility>
#include <vector>

#include "core/base/cancel_poll.h"
#include "core/base/huge_advice.h"

namespace kdray::core {

/// Pixels x0 <= x < x1, y0 <= y < y1 of the whole image; (0, 0) is the top left one.
struct Region {
  int x0 = 0, y0 = 0, x1 = 0, y1 = 0;

  int width() const { return x1 - x0; }
  int height() const { return y1 - y0; }
  std::size_t pixel_count() const {
    return static_cast<std::size_t>(width()) * static_cast<std::size_t>(height());
  }
  friend bool operator==(const Region&, const Region&) = default;
};

/// A block of pixels that one thread renders at a time, in coordinates of the whole image.
using Tile = Region;

/// A region's tiles of at most side x side pixels, row by row. Tiles start at the region's corner:
/// no pixel's value may depend on the tile it lies in.
class TileGrid {
 public:
  TileGrid(const Region& region, int side);

  std::size_t size() const { return columns_ * rows_; }
  Tile operator[](std::size_t i) const;

 private:
  Region region_;
  int side_;
  std::size_t columns_, rows_;
};

/// Row-major [height][width][channels] values of a region, top row first. Different threads may
/// write different pixels.
template <class T>
class Film {
 public:
  Film() = default;
  Film(const Region& region, int channels)
      : region_(region),
        channels_(channels),
        values_(region.pixel_count() * static_cast<std::size_t>(channels)) {}
  /// The same with a poll, because filling gigabytes takes long. Must not be used when the poll has
  /// stopped.
  Film(const Region& region, int channels, CancelPoll* poll)
      : region_(region), channels_(channels) {
    constexpr std::size_t kPiece = std::size_t{1} << 16;
    const std::size_t size = region.pixel_count() * static_cast<std::size_t>(channels);
    values_.reserve(size);
    AdviseHuge(values_.data(), size * sizeof(T));
    while (values_.size() < size && !poll->Spend(kPiece)) {
      values_.resize(std::min(size, values_.size() + kPiece));
    }
  }

  const Region& region() const { return region_; }
  int channels() const { return channels_; }
  std::span<const T> values() const { return values_; }
  std::vector<T> TakeValues() && { return std::move(values_); }

  /// The channels of pixel (x, y) of the whole image, which must lie in region().
  std::span<T> operator()(int x, int y) { return {values_.data() + Offset(x, y), ChannelCount()}; }
  std::span<const T> operator()(int x, int y) const {
    return {values_.data() + Offset(x, y), ChannelCount()};
  }

 private:
  std::size_t ChannelCount() const { return static_cast<std::size_t>(channels_); }
  std::size_t Offset(int x, int y) const {
    const auto row = static_cast<std::size_t>(y - region_.y0);
    const auto column = static_cast<std::size_t>(x - region_.x0);
    return (row * static_cast<std::size_t>(region_.width()) + column) * ChannelCount();
  }

  Region region_;
  int channels_ = 0;
  std::vector<T> values_;
};

}  // namespace kdray::core
