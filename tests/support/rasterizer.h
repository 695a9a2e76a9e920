// SPDX-License-Identifier: Apache-2.0
// A second renderer, to check the first: it projects each triangle and fills it within the bounding
// box of its projection, with a depth buffer. Plain double arithmetic; it shares no code with the
// renderer.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace kdray::test {

using Point3 = std::array<double, 3>;
using Triangle3 = std::array<Point3, 3>;

struct RasterCamera {
  bool perspective = true;
  Point3 eye, target, up;
  double fov_deg = 40;     // vertical
  double view_height = 1;  // not perspective
  int width = 1, height = 1;
};

/// Row-major, top row first; at pixel centres. A miss has depth infinity and triangle -1.
struct Raster {
  int width = 0, height = 0;
  std::vector<double> depth;  // along the view axis
  std::vector<std::int32_t> triangle;
};

/// Triangles are two-sided and closed; at equal depth the smaller number wins. O(triangles + filled
/// pixels).
Raster Rasterize(std::span<const Triangle3> triangles, const RasterCamera& camera);

/// The distance in pixels of image point (x_px, y_px) from the nearest edge of the projected part
/// of the triangle in front of the eye; infinity if no part is.
double DistanceToEdgesPx(const Triangle3& triangle, const RasterCamera& camera, double x_px,
                         double y_px);

}  // namespace kdray::test
