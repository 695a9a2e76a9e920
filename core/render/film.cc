// SPDX-License-Identifier: Apache-2.0
#include "core/render/film.h"

#include <algorithm>

namespace kdray::core {

TileGrid::TileGrid(const Region& region, int side)
    : region_(region),
      side_(side),
      columns_(static_cast<std::size_t>((region.width() + side - 1) / side)),
      rows_(static_cast<std::size_t>((region.height() + side - 1) / side)) {}

Tile TileGrid::operator[](std::size_t i) const {
  const int x = region_.x0 + static_cast<int>(i % columns_) * side_;
  const int y = region_.y0 + static_cast<int>(i / columns_) * side_;
  return {x, y, std::min(x + side_, region_.x1), std::min(y + side_, region_.y1)};
}

}  // namespace kdray::core
