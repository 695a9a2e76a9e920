#include "core/geometry/clip.h"

#include <algorithm>
#include <cstddef>
#include <limits>

#include "core/base/float4.h"

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

// Both halves at once, in floats.
//
// A corner made by clipping is off by at most delta = 2^-21 e + 2^-22 m on each axis, e being the
// triangle's extent and m its largest coordinate there: five roundings of the way along the edge
// and one of the sum are 5/8 and 1/4 of that. Rounding the triangle's own corners to floats moves
// them by less than delta, too. As above, let each plane lie 8 delta outside the box; after it, at
// most five faces of the box, and the cut, a common point is within 7 delta of the polygon, and the
// rest of 8 delta covers the rounding of the planes and of the widening.
namespace {

// What all operations may lose below the normal floats.
constexpr float kUnderflow = 0x1p-140f;

struct FloatPolygon {
  Float4 corners[Polygon::kMaxCorners];
  std::size_t size;
};

struct Range4 {
  Float4 low = Fill4(std::numeric_limits<float>::infinity());
  Float4 high = Fill4(-std::numeric_limits<float>::infinity());

  void Add(Float4 p) {
    low = Min4(low, p);
    high = Max4(high, p);
  }
};

// f(corner) for the corners of the polygon's part on the inner side of the plane, in order.
template <class F>
void ForEachClippedCorner(const FloatPolygon& polygon, int axis, float plane, float side,
                          const F& f) {
  Float4 previous = polygon.corners[polygon.size - 1];
  bool previous_inside = side * (previous[axis] - plane) <= 0;
  for (std::size_t i = 0; i < polygon.size; ++i) {
    const Float4 corner = polygon.corners[i];
    const bool inside = side * (corner[axis] - plane) <= 0;
    if (inside != previous_inside) {
      const float fraction = (plane - previous[axis]) / (corner[axis] - previous[axis]);
      Float4 made = previous + Fill4(fraction) * (corner - previous);
      made[axis] = plane;
      f(made);
    }
    if (inside) f(corner);
    previous = corner;
    previous_inside = inside;
  }
}

Bounds3f ToBounds(const Range4& range, Float4 slack) {
  const Float4 low = range.low - slack;
  const Float4 high = range.high + slack;
  return {{low[0], low[1], low[2]}, {high[0], high[1], high[2]}};
}

// Whether a float can tell the places along the triangle apart.
bool IsResolved(Float4 extent, Float4 largest) {
  constexpr float kResolution = 0x1p-13f;
  for (int axis = 0; axis < 3; ++axis) {
    if (extent[axis] < kResolution * largest[axis] && extent[axis] > 0) return false;
  }
  return true;
}

}  // namespace

ClippedHalves ClippedHalfBounds(const std::array<Vec3d, 3>& corners, const Bounds3f& box,
                                const Bounds3f& bounds, int axis, float position) {
  FloatPolygon polygons[2];
  FloatPolygon* polygon = &polygons[0];
  FloatPolygon* spare = &polygons[1];
  Range4 whole;
  for (std::size_t i = 0; i < 3; ++i) {
    polygon->corners[i] = Float4{static_cast<float>(corners[i].x), static_cast<float>(corners[i].y),
                                 static_cast<float>(corners[i].z), 0};
    whole.Add(polygon->corners[i]);
  }
  polygon->size = 3;
  const Float4 extent = whole.high - whole.low;
  const Float4 largest = Max4(whole.high, -whole.low);
  Bounds3f below_box = box;
  Bounds3f above_box = box;
  below_box.max[axis] = position;
  above_box.min[axis] = position;
  if (!IsResolved(extent, largest)) {
    return {Intersection(ClippedBounds(corners, below_box), bounds),
            Intersection(ClippedBounds(corners, above_box), bounds)};
  }

  const Float4 delta = Fill4(0x1p-21f) * extent + Fill4(0x1p-22f) * largest + Fill4(kUnderflow);
  const Float4 slack = Fill4(8) * delta;
  for (int k = 0; k < 3; ++k) {
    for (const float side : {-1.0f, 1.0f}) {
      const float plane = side < 0 ? box.min[k] : box.max[k];
      if (side < 0 ? whole.low[k] >= plane : whole.high[k] <= plane) continue;
      spare->size = 0;
      ForEachClippedCorner(*polygon, k, plane + side * slack[k], side,
                           [&](Float4 corner) { spare->corners[spare->size++] = corner; });
      std::swap(polygon, spare);
      if (polygon->size == 0) return {Bounds3f::Empty(), Bounds3f::Empty()};
    }
  }

  Range4 below, above;
  const float outward = slack[axis];
  ForEachClippedCorner(*polygon, axis, position + outward, 1.0f, [&](Float4 p) { below.Add(p); });
  ForEachClippedCorner(*polygon, axis, position - outward, -1.0f, [&](Float4 p) { above.Add(p); });
  return {Intersection(ToBounds(below, slack), Intersection(bounds, below_box)),
          Intersection(ToBounds(above, slack), Intersection(bounds, above_box))};
}

}  // namespace kdray::core
