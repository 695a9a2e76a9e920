#include "core/io/polygon.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "core/geometry/power_of_two.h"

namespace kdray::core {
namespace {

// From left to right, then upward: every step of a path goes forward or backward by this order.
bool Before(Point2 a, Point2 b) { return a.x < b.x || (a.x == b.x && a.y < b.y); }

// Newell's normal of a polygon: its components are the areas of the projections, so it is right for
// concave polygons and sensible for warped ones. Seen from the first corner and scaled, so that
// neither a far position nor a small or large size spoils it.
Vec3d NewellNormal(const std::vector<Vec3d>& vertices, std::span<const std::uint32_t> corners) {
  const Vec3d first = vertices[corners[0]];
  double largest = 0;
  for (const std::uint32_t corner : corners) {
    largest = std::max(largest, MaxAbs(vertices[corner] - first));
  }
  if (!(largest > 0) || !std::isfinite(largest)) return {};
  const int scale = -std::ilogb(largest);
  const auto seen = [&](std::uint32_t corner) {
    const Vec3d p = vertices[corner] - first;
    return Vec3d{ScaleByPowerOfTwo(p.x, scale), ScaleByPowerOfTwo(p.y, scale),
                 ScaleByPowerOfTwo(p.z, scale)};
  };
  Vec3d normal;
  Vec3d a = seen(corners.back());
  for (const std::uint32_t corner : corners) {
    const Vec3d b = seen(corner);
    normal = normal + Cross(a, b);
    a = b;
  }
  return normal;
}

// IsConvexPath for the points at(0) .. at(n - 1).
template <class At>
bool IsConvex(std::size_t n, const At& at) {
  std::size_t last = n;
  while (last > 0 && at(last - 1) == at(0)) --last;
  if (last == 0) return true;  // one position only
  Point2 a = at(last - 1);
  Point2 b = at(0);
  bool has_area = false;
  bool turns_back = false;
  int reversals = 0;
  for (std::size_t i = 1; i <= n; ++i) {
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
  return IsConvex(path.size(), [&](std::size_t i) { return path[i]; });
}

Status PolygonCutter::AddOther(std::span<const std::uint32_t> corners) {
  if (corners.size() < 3) {
    ++mesh_->dropped;
    return {};
  }
  const Vec3d normal = NewellNormal(mesh_->vertices, corners);
  const double longest = MaxAbs(normal);
  if (!(longest > 0) || !std::isfinite(longest)) {
    Fan(corners);
    return {};
  }
  // The polygon as seen against its normal, counterclockwise, by leaving out the coordinate along
  // which the normal is longest: no number is rounded.
  const int axis = std::fabs(normal.x) == longest ? 0 : std::fabs(normal.y) == longest ? 1 : 2;
  const auto seen = [&](std::size_t i) {
    const Point2 p = DropAxis(mesh_->vertices[corners[i]], axis);
    return normal[axis] > 0 ? p : Point2{p.y, p.x};
  };
  if (IsConvex(corners.size(), seen)) {
    Fan(corners);
    return {};
  }
  if (corners.size() > kMaxConcaveCorners) {
    return Error{ErrorCode::kMeshTooLarge,
                 "a concave polygon with " + std::to_string(corners.size()) + " corners; at most " +
                     std::to_string(kMaxConcaveCorners) + " are cut"};
  }
  ++mesh_->concave;
  corners_.assign(corners.size(), Corner{});
  for (std::size_t i = 0; i < corners.size(); ++i) corners_[i].point = seen(i);
  return CutEars(corners);
}

void PolygonCutter::Fan(std::span<const std::uint32_t> corners) {
  for (std::size_t i = 2; i < corners.size(); ++i) {
    mesh_->triangles.push_back({corners[0], corners[i - 1], corners[i]});
  }
}

// The points are in corners_. Ear clipping (Meisters, "Polygons Have Ears", 1975): a corner whose
// triangle with its neighbours holds no other corner is cut, until a triangle is left. Cuts only
// make angles smaller, so a corner that has stopped blocking, or does not block an ear, stays so
// until that ear's neighbours change: each ear goes on where its last search stopped
// (Corner::scanned), and all searches together are O(n^2).
Status PolygonCutter::CutEars(std::span<const std::uint32_t> corners) {
  const auto n = static_cast<std::uint32_t>(corners.size());
  blockers_.clear();
  for (std::uint32_t i = 0; i < n; ++i) {
    corners_[i].previous = i == 0 ? n - 1 : i - 1;
    corners_[i].next = i + 1 == n ? 0 : i + 1;
  }
  for (std::uint32_t i = 0; i < n; ++i) {
    Update(i);
    if (corners_[i].turn <= 0) blockers_.push_back(i);
  }

  std::uint32_t current = 0;
  std::uint32_t left = n;
  std::uint32_t tried = 0;  // corners in a row that were no ear
  while (left > 3) {
    if (!IsEar(current)) {
      current = corners_[current].next;
      if (++tried < left) continue;
      current = LeastHarmful(current);
    }
    tried = 0;
    Corner& ear = corners_[current];
    mesh_->triangles.push_back({corners[ear.previous], corners[current], corners[ear.next]});
    ear.left = false;
    corners_[ear.previous].next = ear.next;
    corners_[ear.next].previous = ear.previous;
    Update(ear.previous);
    Update(ear.next);
    // Going on one corner further gives rounder triangles than a fan around one corner.
    current = corners_[ear.next].next;
    --left;
    if (left % 256 == 0 && cancel_.ShouldStop()) return cancel_.ToError();
  }
  const Corner& last = corners_[current];
  mesh_->triangles.push_back({corners[last.previous], corners[current], corners[last.next]});
  return {};
}

void PolygonCutter::Update(std::uint32_t corner) {
  Corner& c = corners_[corner];
  c.turn = static_cast<std::int8_t>(
      Orient2d(corners_[c.previous].point, c.point, corners_[c.next].point));
  c.scanned = 0;
}

bool PolygonCutter::IsEar(std::uint32_t corner) {
  Corner& ear = corners_[corner];
  if (ear.turn <= 0) return false;
  const Corner& a = corners_[ear.previous];
  const Corner& c = corners_[ear.next];
  for (; ear.scanned < blockers_.size(); ++ear.scanned) {
    if (Blocks(corners_[blockers_[ear.scanned]], a, ear, c)) return false;
  }
  return true;
}

// If any corner is inside the triangle or on its diagonal, so is one that is no strict left turn. A
// corner on one of the two edges, or at the position of a, b or c, does not block: where a path
// only touches itself (along the bridge to a hole), the other part lies on the outer side.
bool PolygonCutter::Blocks(const Corner& other, const Corner& a, const Corner& b,
                           const Corner& c) const {
  if (!other.left || other.turn > 0) return false;
  const Point2 p = other.point;
  if (p == a.point || p == b.point || p == c.point) return false;
  return Orient2d(a.point, b.point, p) > 0 && Orient2d(b.point, c.point, p) > 0 &&
         Orient2d(c.point, a.point, p) >= 0;
}

// No corner is an ear: the path crosses or overlaps itself. A corner without area does no harm;
// else one that at least keeps the winding.
std::uint32_t PolygonCutter::LeastHarmful(std::uint32_t start) const {
  std::uint32_t left_turn = start;
  std::uint32_t i = start;
  do {
    if (corners_[i].turn == 0) return i;
    if (corners_[i].turn > 0 && corners_[left_turn].turn <= 0) left_turn = i;
    i = corners_[i].next;
  } while (i != start);
  return left_turn;
}

}  // namespace kdray::core
