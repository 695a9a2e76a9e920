// SPDX-License-Identifier: Apache-2.0
#include "core/geometry/least_area.h"

#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>

namespace kdray::core {

// Dynamic program over parts i .. j of the path, shorter parts first: the best corner k combines
// the triangle i, k, j with the best triangles of the parts i .. k and k .. j.
void CutWithLeastArea(std::span<const Point2> path, CutMeter* meter,
                      std::vector<std::array<std::uint32_t, 3>>* triangles) {
  struct Part {
    double area = 0;
    std::uint32_t middle = 0;
  };
  const std::size_t n = path.size();
  std::vector<Part> parts(n * n);
  const auto part = [&](std::size_t i, std::size_t j) -> Part& { return parts[i * n + j]; };
  for (std::size_t length = 2; length < n; ++length) {
    for (std::size_t i = 0; i + length < n; ++i) {
      if (meter->Spend(4 * length)) return;
      const std::size_t j = i + length;
      const Point2 base = {path[j].x - path[i].x, path[j].y - path[i].y};
      Part best = {std::numeric_limits<double>::infinity(), static_cast<std::uint32_t>(i + 1)};
      for (std::size_t k = i + 1; k < j; ++k) {
        const double own =
            std::fabs(base.x * (path[k].y - path[i].y) - base.y * (path[k].x - path[i].x));
        const double area = part(i, k).area + part(k, j).area + own;
        if (area < best.area) best = {area, static_cast<std::uint32_t>(k)};
      }
      part(i, j) = best;
    }
  }
  std::vector<std::pair<std::uint32_t, std::uint32_t>> open = {
      {0, static_cast<std::uint32_t>(n - 1)}};
  while (!open.empty()) {
    const auto [i, j] = open.back();
    open.pop_back();
    if (j - i < 2) continue;
    const std::uint32_t k = part(i, j).middle;
    triangles->push_back({i, k, j});
    open.push_back({k, j});
    open.push_back({i, k});
  }
}

}  // namespace kdray::core
