#include "core/geometry/clip.h"

#include <algorithm>
#include <cstddef>

namespace kdray::core {

namespace {

// A convex polygon, one array per axis. A plane adds one corner for every run of corners that it
// cuts off. Rounding may dent the polygon, so that there are several runs; even if every second
// corner were cut off each time, six planes would leave 28.
struct Polygon {
  static constexpr std::size_t kMaxCorners = 28;
  double at[3][kMaxCorners];
  std::size_t size;
};

// Keeps what lies on the inner side of the plane: at most it (side = 1), at least it (side = -1).
void ClipAtPlane(const Polygon& in, std::size_t axis, double plane, double side, Polygon* out) {
  const std::size_t other[2] = {(axis + 1) % 3, (axis + 2) % 3};
  out->size = 0;
  std::size_t previous = in.size - 1;
  bool previous_inside = side * (in.at[axis][previous] - plane) <= 0;
  for (std::size_t i = 0; i < in.size; ++i) {
    const bool inside = side * (in.at[axis][i] - plane) <= 0;
    if (inside != previous_inside) {
      const double from = in.at[axis][previous];
      const double fraction = (plane - from) / (in.at[axis][i] - from);
      out->at[axis][out->size] = plane;
      for (const std::size_t k : other) {
        out->at[k][out->size] = in.at[k][previous] + fraction * (in.at[k][i] - in.at[k][previous]);
      }
      ++out->size;
    }
    if (inside) {
      for (std::size_t k = 0; k < 3; ++k) out->at[k][out->size] = in.at[k][i];
      ++out->size;
    }
    previous = i;
    previous_inside = inside;
  }
}

}  // namespace

Bounds3f ClippedBounds(const std::array<Vec3d, 3>& corners, const Bounds3f& box) {
  Bounds3d whole = Bounds3d::Empty();
  for (const Vec3d& corner : corners) whole.Extend(corner);
  const Bounds3f allowed = Intersection(RoundOutward(whole), box);
  if (allowed.IsEmpty()) return Bounds3f::Empty();

  // A corner made by clipping is off by at most delta = 2^-49 m, m being the largest coordinate:
  // some 12 roundings of 2^-53 m. Let each plane lie 2^-46 m = 8 delta outside the box. Then by
  // induction over the planes every common point Q of triangle and box stays within k delta of the
  // polygon after k planes: the point of the polygon next to Q is inside the moved plane, and the
  // new corners' rounding moves the convex hull by delta at most. So the final bounds, widened by
  // as much again, contain Q. The second term covers underflow.
  const double m = std::max(MaxAbs(whole.min), MaxAbs(whole.max));
  const double slack = 0x1p-46 * m + std::numeric_limits<double>::min();

  Polygon polygons[2];
  Polygon* polygon = &polygons[0];
  Polygon* spare = &polygons[1];
  polygon->size = 3;
  for (std::size_t i = 0; i < 3; ++i) {
    for (int axis = 0; axis < 3; ++axis) polygon->at[axis][i] = corners[i][axis];
  }
  bool cut = false;
  for (int axis = 0; axis < 3; ++axis) {
    const double low = static_cast<double>(box.min[axis]);
    const double high = static_cast<double>(box.max[axis]);
    for (const double side : {-1.0, 1.0}) {
      if (side < 0 ? whole.min[axis] >= low : whole.max[axis] <= high) continue;
      ClipAtPlane(*polygon, static_cast<std::size_t>(axis), (side < 0 ? low : high) + side * slack,
                  side, spare);
      std::swap(polygon, spare);
      if (polygon->size == 0) return Bounds3f::Empty();
      cut = true;
    }
  }
  if (!cut) return allowed;

  Bounds3d clipped;
  for (int axis = 0; axis < 3; ++axis) {
    const double* begin = polygon->at[axis];
    const auto [low, high] = std::minmax_element(begin, begin + polygon->size);
    clipped.min[axis] = *low - slack;
    clipped.max[axis] = *high + slack;
  }
  // The triangle's own bounds take the slack away again wherever the extreme point is a corner.
  return Intersection(RoundOutward(clipped), allowed);
}

}  // namespace kdray::core
