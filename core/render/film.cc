#include "core/render/film.h"

#include <algorithm>

namespace kdray::core {

std::vector<Tile> CutIntoTiles(const Region& region, int side) {
  std::vector<Tile> tiles;
  for (int y = region.y0; y < region.y1; y += side) {
    for (int x = region.x0; x < region.x1; x += side) {
      tiles.push_back({x, y, std::min(x + side, region.x1), std::min(y + side, region.y1)});
    }
  }
  return tiles;
}

}  // namespace kdray::core
