// SPDX-License-Identifier: Apache-2.0
#include "core/geometry/chord_depth.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

namespace kdray::core {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// Distance of p from the line through a and b, positive on its left.
double Distance(Point2 a, Point2 b, Point2 p) {
  const double x = b.x - a.x;
  const double y = b.y - a.y;
  return (x * (p.y - a.y) - y * (p.x - a.x)) / std::hypot(x, y);
}

}  // namespace

double SmallestHeight(const Triangle2& t) {
  double height = kInfinity;
  for (std::size_t i = 0; i < 3; ++i) {
    const double distance = std::fabs(Distance(t[i], t[(i + 1) % 3], t[(i + 2) % 3]));
    if (distance < height) height = distance;
  }
  return height;
}

double ChordDepth(const Triangle2& triangle, Point2 p, Point2 q) {
  std::array<double, 3> from;
  std::array<double, 3> to;
  double begin = 0;
  double end = 1;
  for (std::size_t i = 0; i < 3; ++i) {
    from[i] = Distance(triangle[i], triangle[(i + 1) % 3], p);
    to[i] = Distance(triangle[i], triangle[(i + 1) % 3], q);
    if (from[i] <= 0 && to[i] <= 0) return 0;
    const double where = from[i] / (from[i] - to[i]);
    if (from[i] < 0) begin = std::max(begin, where);
    if (to[i] < 0) end = std::min(end, where);
  }
  double depth = 0;
  for (const double part : {0.0, 0.25, 0.5, 0.75, 1.0}) {
    const double t = begin + part * (end - begin);
    double least = kInfinity;
    for (std::size_t i = 0; i < 3; ++i) least = std::min(least, from[i] + t * (to[i] - from[i]));
    depth = std::max(depth, least);
  }
  return depth;
}

}  // namespace kdray::core
