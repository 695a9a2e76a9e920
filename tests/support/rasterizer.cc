// SPDX-License-Identifier: Apache-2.0
#include "tests/support/rasterizer.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace kdray::test {
namespace {

Point3 Subtract(const Point3& a, const Point3& b) {
  return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}
double Inner(const Point3& a, const Point3& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
Point3 Outer(const Point3& a, const Point3& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
Point3 Unit(const Point3& a) {
  const double length = std::hypot(a[0], a[1], a[2]);
  return {a[0] / length, a[1] / length, a[2] / length};
}

// A corner in front of the camera: sideways, upward, ahead.
struct Seen {
  double x, y, z;
};

// A corner in the image, and 1 / z (perspective) or z, which is linear in the image.
struct Projected {
  double x, y, w;
};

class Projector {
 public:
  explicit Projector(const RasterCamera& camera) : camera_(camera) {
    ahead_ = Unit(Subtract(camera.target, camera.eye));
    side_ = Unit(Outer(ahead_, camera.up));
    above_ = Outer(side_, ahead_);
    const double half_height = camera.perspective
                                   ? std::tan(camera.fov_deg * std::acos(-1.0) / 360.0)
                                   : camera.view_height / 2;
    pixels_per_unit_ = camera.height / (2 * half_height);
  }

  Seen See(const Point3& p) const {
    const Point3 d = Subtract(p, camera_.eye);
    return {Inner(d, side_), Inner(d, above_), Inner(d, ahead_)};
  }
  Projected Project(const Seen& s) const {
    const double shrink = camera_.perspective ? s.z : 1.0;
    return {camera_.width / 2.0 + pixels_per_unit_ * s.x / shrink,
            camera_.height / 2.0 - pixels_per_unit_ * s.y / shrink,
            camera_.perspective ? 1 / s.z : s.z};
  }
  double DepthOf(double w) const { return camera_.perspective ? 1 / w : w; }

 private:
  RasterCamera camera_;
  Point3 ahead_{}, side_{}, above_{};
  double pixels_per_unit_ = 0;
};

// The part of a triangle at depth >= nearest: no corner, or 3 or 4.
std::vector<Seen> ClipNear(const std::array<Seen, 3>& corners, double nearest) {
  std::vector<Seen> kept;
  for (std::size_t i = 0; i < 3; ++i) {
    const Seen& a = corners[i];
    const Seen& b = corners[(i + 1) % 3];
    if (a.z >= nearest) kept.push_back(a);
    if ((a.z >= nearest) != (b.z >= nearest)) {
      const double s = (nearest - a.z) / (b.z - a.z);
      kept.push_back({a.x + s * (b.x - a.x), a.y + s * (b.y - a.y), nearest});
    }
  }
  return kept;
}

// Twice the signed area of (p, a, b). Moving p to 0 first makes swapping a and b an exact change of
// sign, so that two triangles sharing an edge agree on which side a pixel is.
double EdgeFunction(const Projected& a, const Projected& b, double px, double py) {
  return (a.x - px) * (b.y - py) - (a.y - py) * (b.x - px);
}

void Fill(const std::array<Projected, 3>& t, std::int32_t id, const Projector& projector,
          Raster* raster) {
  const auto [left, right] = std::minmax({t[0].x, t[1].x, t[2].x});
  const auto [top, bottom] = std::minmax({t[0].y, t[1].y, t[2].y});
  const auto pixel = [](double at, int count) {
    return static_cast<int>(std::clamp(std::floor(at), 0.0, static_cast<double>(count)));
  };
  const int x_end = pixel(right + 1, raster->width);
  const int y_end = pixel(bottom + 1, raster->height);
  for (int y = pixel(top - 1, raster->height); y < y_end; ++y) {
    for (int x = pixel(left - 1, raster->width); x < x_end; ++x) {
      const double px = x + 0.5;
      const double py = y + 0.5;
      const double e0 = EdgeFunction(t[1], t[2], px, py);
      const double e1 = EdgeFunction(t[2], t[0], px, py);
      const double e2 = EdgeFunction(t[0], t[1], px, py);
      const bool inside = (e0 >= 0 && e1 >= 0 && e2 >= 0) || (e0 <= 0 && e1 <= 0 && e2 <= 0);
      const double sum = e0 + e1 + e2;
      if (!inside || sum == 0) continue;
      const double depth = projector.DepthOf((e0 * t[0].w + e1 * t[1].w + e2 * t[2].w) / sum);
      const std::size_t at = static_cast<std::size_t>(y) * static_cast<std::size_t>(raster->width) +
                             static_cast<std::size_t>(x);
      // Triangles come in ascending order, so at equal depth the first one stays.
      if (depth < raster->depth[at]) {
        raster->depth[at] = depth;
        raster->triangle[at] = id;
      }
    }
  }
}

}  // namespace

Raster Rasterize(std::span<const Triangle3> triangles, const RasterCamera& camera) {
  Raster raster;
  raster.width = camera.width;
  raster.height = camera.height;
  const std::size_t pixels =
      static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
  raster.depth.assign(pixels, std::numeric_limits<double>::infinity());
  raster.triangle.assign(pixels, -1);

  const Projector projector(camera);
  double farthest = 0;
  for (const Triangle3& triangle : triangles) {
    for (const Point3& p : triangle) farthest = std::max(farthest, projector.See(p).z);
  }
  // Before the division by depth, a triangle that reaches behind the eye is cut short of it.
  const double nearest = camera.perspective ? farthest * 1e-9 : 0.0;
  std::int32_t id = 0;
  for (const Triangle3& triangle : triangles) {
    const std::vector<Seen> part = ClipNear(
        {projector.See(triangle[0]), projector.See(triangle[1]), projector.See(triangle[2])},
        nearest);
    for (std::size_t i = 2; i < part.size(); ++i) {
      Fill({projector.Project(part[0]), projector.Project(part[i - 1]), projector.Project(part[i])},
           id, projector, &raster);
    }
    ++id;
  }
  return raster;
}

double DistanceToEdgesPx(const Triangle3& triangle, const RasterCamera& camera, double x_px,
                         double y_px) {
  const Projector projector(camera);
  const std::array<Seen, 3> corners = {projector.See(triangle[0]), projector.See(triangle[1]),
                                       projector.See(triangle[2])};
  const double farthest = std::max({corners[0].z, corners[1].z, corners[2].z});
  const std::vector<Seen> part = ClipNear(corners, camera.perspective ? farthest * 1e-9 : 0.0);
  double best = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < part.size(); ++i) {
    const Projected a = projector.Project(part[i]);
    const Projected b = projector.Project(part[(i + 1) % part.size()]);
    const double dx = b.x - a.x;
    const double dy = b.y - a.y;
    const double length2 = dx * dx + dy * dy;
    const double s =
        length2 > 0 ? std::clamp(((x_px - a.x) * dx + (y_px - a.y) * dy) / length2, 0.0, 1.0) : 0.0;
    best = std::min(best, std::hypot(x_px - a.x - s * dx, y_px - a.y - s * dy));
  }
  return best;
}

}  // namespace kdray::test
