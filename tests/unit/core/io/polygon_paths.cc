// SPDX-License-Identifier: Apache-2.0
#include "tests/unit/core/io/polygon_paths.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>

#include "core/geometry/ear_cutter.h"
#include "core/io/polygon.h"

namespace kdray::core {

std::int64_t DoubleArea(Place a, Place b, Place c) {
  return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
}

std::int64_t DoubleArea(const Path& path) {
  std::int64_t sum = 0;
  for (std::size_t i = 2; i < path.size(); ++i) sum += DoubleArea(path[0], path[i - 1], path[i]);
  return sum;
}

int Side(Place a, Place b, Place c) {
  const std::int64_t area = DoubleArea(a, b, c);
  return area > 0 ? 1 : area < 0 ? -1 : 0;
}

bool Cross(Place a, Place b, Place c, Place d) {
  return Side(a, b, c) * Side(a, b, d) < 0 && Side(c, d, a) * Side(c, d, b) < 0;
}

bool IsOn(Place p, Place a, Place b) {
  return Side(a, b, p) == 0 && std::min(a.x, b.x) <= p.x && p.x <= std::max(a.x, b.x) &&
         std::min(a.y, b.y) <= p.y && p.y <= std::max(a.y, b.y);
}

Place Next(const Path& path, std::size_t i) { return path[i + 1 == path.size() ? 0 : i + 1]; }

bool CrossesItself(const Path& path) {
  for (std::size_t i = 0; i < path.size(); ++i) {
    for (std::size_t j = i + 2; j < path.size(); ++j) {
      if (Cross(path[i], Next(path, i), path[j], Next(path, j))) return true;
    }
  }
  return false;
}

int Winding(const Path& path, double x, double y) {
  int winding = 0;
  for (std::size_t i = 0; i < path.size(); ++i) {
    const Place a = path[i];
    const Place b = Next(path, i);
    const auto ax = static_cast<double>(a.x);
    const auto ay = static_cast<double>(a.y);
    const auto bx = static_cast<double>(b.x);
    const auto by = static_cast<double>(b.y);
    if ((ay <= y) == (by <= y)) continue;
    const double side = (bx - ax) * (y - ay) - (by - ay) * (x - ax);
    if (ay <= y && side > 0) ++winding;
    if (ay > y && side < 0) --winding;
  }
  return winding;
}

namespace {

std::vector<Vec3d> InPlane(const Path& path, int plane) {
  std::vector<Vec3d> corners;
  for (const Place p : path) {
    const auto x = static_cast<double>(p.x);
    const auto y = static_cast<double>(p.y);
    corners.push_back(plane == 0   ? Vec3d{x, y, 7}
                      : plane == 1 ? Vec3d{7, x, y}
                      : plane == 2 ? Vec3d{y, 7, x}
                                   : Vec3d{x, y, 2 * x - 3 * y + 5});
  }
  return corners;
}

}  // namespace

MeshData Cut(const Path& path, int plane) {
  MeshData data;
  data.vertices = InPlane(path, plane);
  std::vector<std::uint32_t> corners(path.size());
  std::iota(corners.begin(), corners.end(), 0u);
  EXPECT_TRUE(PolygonCutter(&data, {}).Add(corners).ok());
  return data;
}

std::string Text(const Path& path) {
  std::string text;
  for (const Place p : path) text += " (" + std::to_string(p.x) + ", " + std::to_string(p.y) + ")";
  return text;
}

void ExpectCoversOnce(const Path& path, int plane) {
  const MeshData data = Cut(path, plane);
  ASSERT_EQ(data.triangles.size(), path.size() - 2);
  const std::int64_t area = DoubleArea(path);
  std::int64_t sum = 0;
  for (const auto& [a, b, c] : data.triangles) {
    const std::int64_t part = DoubleArea(path[a], path[b], path[c]);
    ASSERT_GE(area > 0 ? part : -part, 0) << a << ' ' << b << ' ' << c << " of" << Text(path);
    sum += part;
  }
  ASSERT_EQ(sum, area) << Text(path);
}

void ExpectEarsSuffice(Path path) {
  if (DoubleArea(path) < 0) std::reverse(path.begin(), path.end());
  std::vector<Point2> points;
  for (const Place p : path) points.push_back({static_cast<double>(p.x), static_cast<double>(p.y)});
  CutMeter meter({});
  meter.Allow(std::uint64_t{1} << 40);
  std::vector<EarCutter::Triangle> triangles;
  EXPECT_EQ(EarCutter(&meter).Cut(points, false, &triangles), EarCutter::Outcome::kDone)
      << Text(path);
}

}  // namespace kdray::core
