// SPDX-License-Identifier: Apache-2.0
#include "core/io/polygon.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "core/geometry/least_area.h"
#include "core/geometry/power_of_two.h"

namespace kdray::core {
namespace {

// From left to right, then upward: every step of a path goes forward or backward by this order.
bool Before(Point2 a, Point2 b) { return a.x < b.x || (a.x == b.x && a.y < b.y); }

// Two normals of a polygon, each as long as an area.
struct Normals {
  Vec3d newell;    // its components are the areas of the projections
  Vec3d widest;    // that of the largest triangle of the fan from the first corner
  double sum = 0;  // of the sizes of the fan's triangles: tells how much of `newell` is rounding
};

// Computed relative to the first corner and scaled, so neither a distant position nor an extreme
// size makes them inaccurate. Zero when they cannot be computed, or the meter stops.
Normals NormalsOf(const std::vector<Vec3d>& vertices, std::span<const std::uint32_t> corners,
                  CutMeter* meter) {
  const Vec3d first = vertices[corners[0]];
  double largest = 0;
  for (const std::uint32_t corner : corners) {
    if (meter->Spend(4)) return {};
    largest = std::max(largest, MaxAbs(vertices[corner] - first));
  }
  if (!(largest > 0) || !std::isfinite(largest)) return {};
  const int scale = -std::ilogb(largest);
  const auto seen = [&](std::uint32_t corner) {
    const Vec3d p = vertices[corner] - first;
    return Vec3d{ScaleByPowerOfTwo(p.x, scale), ScaleByPowerOfTwo(p.y, scale),
                 ScaleByPowerOfTwo(p.z, scale)};
  };
  Normals normals;
  Vec3d a = seen(corners.back());
  for (const std::uint32_t corner : corners) {
    if (meter->Spend(8)) return {};
    const Vec3d b = seen(corner);
    const Vec3d part = Cross(a, b);
    normals.newell = normals.newell + part;
    normals.sum += MaxAbs(part);
    if (MaxAbs(part) > MaxAbs(normals.widest)) normals.widest = part;
    a = b;
  }
  return normals;
}

// Positive when more of the path goes counterclockwise. Rounded.
double SignedArea(std::span<const Point2> path) {
  double sum = 0;
  for (std::size_t i = 2; i < path.size(); ++i) {
    sum += (path[i - 1].x - path[0].x) * (path[i].y - path[0].y) -
           (path[i - 1].y - path[0].y) * (path[i].x - path[0].x);
  }
  return sum;
}

// IsConvexPath for the points at(0) .. at(n - 1). Unspecified when stopped() returns true.
template <class At, class Stopped>
bool IsConvex(std::size_t n, const At& at, const Stopped& stopped) {
  std::size_t last = n;
  while (last > 0 && at(last - 1) == at(0)) --last;
  if (last == 0) return true;  // one position only
  Point2 a = at(last - 1);
  Point2 b = at(0);
  bool has_area = false;
  bool turns_back = false;
  int reversals = 0;
  for (std::size_t i = 1; i <= n && !stopped(); ++i) {
    const Point2 c = at(i == n ? 0 : i);
    if (c == b) continue;
    const int turn = Orient2d(a, b, c);
    if (turn < 0) return false;
    has_area = has_area || turn > 0;
    if (Before(a, b) != Before(b, c)) {
      ++reversals;
      turns_back = turns_back || turn == 0;
    }
    a = b;
    b = c;
  }
  // Left turns only, and once forward and once backward: the direction makes one full circle.
  return !has_area || (!turns_back && reversals <= 2);
}

}  // namespace

bool IsConvexPath(std::span<const Point2> path) {
  return IsConvex(
      path.size(), [&](std::size_t i) { return path[i]; }, [] { return false; });
}

PolygonCutter::PolygonCutter(MeshData* mesh, CancelToken cancel, std::uint64_t steps_per_file,
                             std::vector<TriangleIndices>* cuts)
    : mesh_(mesh), meter_(std::move(cancel)), ears_(&meter_), cuts_(cuts) {
  meter_.Allow(steps_per_file);
}

Status PolygonCutter::AddOther(std::span<const std::uint32_t> corners) {
  if (corners.size() < 3) {
    ++mesh_->dropped;
    return {};
  }
  meter_.Allow(kStepsPerCorner * corners.size());
  const View view = ViewOf(corners);
  const bool is_convex =
      view.axis < 0 ||
      (view.is_certain && IsConvex(
                              corners.size(), [&](std::size_t i) { return Seen(corners[i], view); },
                              [&] { return meter_.Spend(8); }));
  if (is_convex) {
    Fan(corners);
  } else if (corners.size() > kMaxConcaveCorners) {
    return Error{ErrorCode::kInvalidMesh,
                 "a concave polygon with " + std::to_string(corners.size()) + " corners; at most " +
                     std::to_string(kMaxConcaveCorners) + " are allowed"};
  } else {
    CutConcave(corners, view);
  }
  if (meter_.stopped()) return WhyStopped(corners.size());
  if (!is_convex) ++mesh_->concave;
  return {};
}

// Drops the coordinate along which the normal is longest, so the polygon is counterclockwise and no
// number is rounded. Where areas cancel, for example on a path that only goes out and back,
// Newell's normal is only rounding error. Then the axis comes from the largest triangle, and the
// winding must be determined. Negative axis: the corners lie on one line.
PolygonCutter::View PolygonCutter::ViewOf(std::span<const std::uint32_t> corners) {
  const Normals normals = NormalsOf(mesh_->vertices, corners, &meter_);
  if (!(MaxAbs(normals.widest) > 0) || !std::isfinite(normals.sum)) return {-1, false, false};
  constexpr double kRounding = 0x1p-30;
  const bool is_certain = MaxAbs(normals.newell) > kRounding * normals.sum;
  const Vec3d normal = is_certain ? normals.newell : normals.widest;
  const double longest = MaxAbs(normal);
  const int axis = std::fabs(normal.x) == longest ? 0 : std::fabs(normal.y) == longest ? 1 : 2;
  return {axis, normal[axis] < 0, is_certain};
}

Point2 PolygonCutter::Seen(std::uint32_t corner, const View& view) const {
  const Point2 p = DropAxis(mesh_->vertices[corner], view.axis);
  return view.mirrored ? Point2{p.y, p.x} : p;
}

void PolygonCutter::Fan(std::span<const std::uint32_t> corners) {
  for (std::size_t i = 2; i < corners.size() && !meter_.Spend(2); ++i) {
    mesh_->triangles.push_back({corners[0], corners[i - 1], corners[i]});
    if (cuts_ == nullptr) continue;
    cuts_->push_back({0, static_cast<std::uint32_t>(i - 1), static_cast<std::uint32_t>(i)});
  }
}

// First ear clipping, which is right if it ends; then the best choice for a path that is not weakly
// simple. Triangles are written with corner positions in the polygon, which are replaced by vertex
// numbers at the end.
void PolygonCutter::CutConcave(std::span<const std::uint32_t> corners, const View& view) {
  path_.clear();
  for (const std::uint32_t corner : corners) path_.push_back(Seen(corner, view));
  if (!view.is_certain && SignedArea(path_) < 0) MirrorPath();
  const std::size_t first = mesh_->triangles.size();
  const auto is_cut_by_ears = [&] {
    mesh_->triangles.resize(first);
    return ears_.Cut(path_, false, &mesh_->triangles) != EarCutter::Outcome::kStuck;
  };
  bool is_cut = is_cut_by_ears();
  if (!is_cut && !view.is_certain) {
    MirrorPath();
    is_cut = is_cut_by_ears();
    if (!is_cut) MirrorPath();
  }
  if (!is_cut) {
    mesh_->triangles.resize(first);
    if (path_.size() <= kMaxLeastAreaCorners) {
      CutWithLeastArea(path_, &meter_, &mesh_->triangles);
    } else {
      ears_.Cut(path_, true, &mesh_->triangles);
    }
  }
  for (std::size_t i = first; i < mesh_->triangles.size(); ++i) {
    if (cuts_ != nullptr) cuts_->push_back(mesh_->triangles[i]);
    for (std::uint32_t& corner : mesh_->triangles[i]) corner = corners[corner];
  }
}

void PolygonCutter::MirrorPath() {
  for (Point2& point : path_) std::swap(point.x, point.y);
}

Status PolygonCutter::WhyStopped(std::size_t corners) const {
  if (!meter_.exhausted()) return meter_.ToError();
  return Error{ErrorCode::kInvalidMesh,
               "cutting the polygons up to this one, of " + std::to_string(corners) +
                   " corners, into triangles takes more than the " +
                   std::to_string(meter_.allowed()) +
                   " steps allowed; polygons that cost so much cross themselves very often"};
}

}  // namespace kdray::core
