// SPDX-License-Identifier: Apache-2.0
// Rays through the centres of a tile's pixels. core/render/camera_rays.h makes those of samples
// beside them.
#pragma once

#include <array>
#include <cassert>
#include <cstddef>

#include "core/geometry/ray.h"
#include "core/render/camera.h"
#include "core/render/film.h"
#include "core/render/pixel_order.h"
#include "core/render/store_ray.h"

namespace kdray::core {

/// Camera::RayThrough for the centres of a tile's pixels, with the part of each row and column
/// computed once. The camera must outlive it.
class CentreRays {
 public:
  static constexpr int kMostSide = 64;

  /// `tile` has at most kMostSide pixels a side.
  CentreRays(const Camera& camera, const Tile& tile) : camera_(camera) {
    assert(tile.width() <= kMostSide && tile.height() <= kMostSide);
    for (int x = tile.x0; x < tile.x1; ++x) columns_[Index(x - tile.x0)] = camera.ColumnAt(x + 0.5);
    for (int y = tile.y0; y < tile.y1; ++y) rows_[Index(y - tile.y0)] = camera.RowAt(y + 0.5);
  }

  /// The ray through the centre of the pixel in that column and row of the tile, from 0.
  Ray operator()(int column, int row) const {
    return camera_.RayThrough(columns_[Index(column)], rows_[Index(row)]);
  }

 private:
  static std::size_t Index(int i) { return static_cast<std::size_t>(i); }

  const Camera& camera_;
  std::array<Camera::Column, kMostSide> columns_;
  std::array<Camera::Row, kMostSide> rows_;
};

/// Writes the rays through the centres of a tile's pixels, in the order of ForEachInPixelOrder.
inline void WriteCentreRays(const Camera& camera, const Tile& tile, Ray* rays) {
  const CentreRays centre(camera, tile);
  ForEachInPixelOrder(tile.width(), tile.height(),
                      [&](int x, int y) { StoreRay(centre(x, y), rays++); });
}

}  // namespace kdray::core
