// SPDX-License-Identifier: Apache-2.0
#include "core/geometry/clip.h"

#include <algorithm>
#include <cstddef>
#include <limits>

#include "core/base/float4.h"

namespace kdray::core {

namespace {

// A convex polygon, one array per axis. A plane adds one corner for every run of corners that it
// cuts off. Rounding may make the polygon slightly concave, with several runs. Even if each of six
// planes cut off every second corner, 28 would remain.
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

// More than all operations can lose to underflow; itself a normal number, because processors are
// slow on denormals.
constexpr float kUnderflow = 0x1p-120f;

struct FloatPolygon {
  // One more than needed: each corner is written before it is known whether it counts.
  Float4 corners[Polygon::kMaxCorners + 1];
  std::size_t size;
};

// All bits of the lane of `axis`.
Int4 LaneOf(int axis) { return Int4{0, 1, 2, 3} == Int4{axis, axis, axis, axis}; }

bool IsAny(Int4 lanes) { return (lanes[0] | lanes[1] | lanes[2]) != 0; }

// Where the edge meets the plane across the axis whose lane is given; anything when it does not.
Float4 Crossing(Float4 from, Float4 edge, float from_at, float edge_at, float plane, Int4 lane) {
  const Float4 made = from + Fill4((plane - from_at) / edge_at) * edge;
  return lane ? Fill4(plane) : made;
}

// Keeps what lies on the inner side of the plane. Without branches, which would be unpredictable,
// and without writing single lanes, which would stall the next read.
void ClipAtPlane(const FloatPolygon& in, int axis, float plane, float side, FloatPolygon* out) {
  const Int4 lane = LaneOf(axis);
  Float4 previous = in.corners[in.size - 1];
  float previous_at = previous[axis];
  bool previous_inside = side * (previous_at - plane) <= 0;
  std::size_t size = 0;
  for (std::size_t i = 0; i < in.size; ++i) {
    const Float4 corner = in.corners[i];
    const float at = corner[axis];
    const bool inside = side * (at - plane) <= 0;
    out->corners[size] =
        Crossing(previous, corner - previous, previous_at, at - previous_at, plane, lane);
    size += static_cast<std::size_t>(inside != previous_inside);
    out->corners[size] = corner;
    size += static_cast<std::size_t>(inside);
    previous = corner;
    previous_at = at;
    previous_inside = inside;
  }
  out->size = size;
}

// The bounds of a polygon's part on one side of a plane.
class HalfRange {
 public:
  // side 1: below the plane; -1: above.
  HalfRange(int axis, float plane, float side) : lane_(LaneOf(axis)), plane_(plane), side_(side) {}

  bool IsInside(float at) const { return side_ * (at - plane_) <= 0; }
  // The next corner, and the edge that leads to it.
  void Add(Float4 from, Float4 edge, float from_at, float edge_at, bool from_inside, Float4 corner,
           bool inside) {
    const Float4 made = Crossing(from, edge, from_at, edge_at, plane_, lane_);
    Extend(made, inside != from_inside);
    Extend(corner, inside);
  }
  Float4 low() const { return low_; }
  Float4 high() const { return high_; }

 private:
  void Extend(Float4 p, bool counts) {
    const std::int32_t bits = -static_cast<std::int32_t>(counts);
    const Int4 all = {bits, bits, bits, bits};
    constexpr float kInf = std::numeric_limits<float>::infinity();
    low_ = Min4(low_, all ? p : Fill4(kInf));
    high_ = Max4(high_, all ? p : Fill4(-kInf));
  }

  Int4 lane_;
  float plane_;
  float side_;
  Float4 low_ = Fill4(std::numeric_limits<float>::infinity());
  Float4 high_ = Fill4(-std::numeric_limits<float>::infinity());
};

// Whether floats resolve positions along the triangle.
bool IsResolved(Float4 extent, Float4 largest) {
  constexpr float kResolution = 0x1p-13f;
  return !IsAny((extent < Fill4(kResolution) * largest) & (extent > Fill4(0)));
}

Bounds3f Common(Float4 low, Float4 high, const Bounds3f& a, const Bounds3f& b) {
  return Intersection(Bounds3f{{low[0], low[1], low[2]}, {high[0], high[1], high[2]}},
                      Intersection(a, b));
}

template <class T>
ClippedHalves HalfBounds(const std::array<Vec3<T>, 3>& corners, const Bounds3f& box,
                         const Bounds3f& bounds, int axis, float position) {
  FloatPolygon polygons[2];
  FloatPolygon* polygon = &polygons[0];
  FloatPolygon* spare = &polygons[1];
  for (std::size_t i = 0; i < 3; ++i) {
    polygon->corners[i] = Float4{static_cast<float>(corners[i].x), static_cast<float>(corners[i].y),
                                 static_cast<float>(corners[i].z), 0};
  }
  polygon->size = 3;
  const Float4* const c = polygon->corners;
  const Float4 low = Min4(Min4(c[0], c[1]), c[2]);
  const Float4 high = Max4(Max4(c[0], c[1]), c[2]);
  const Float4 extent = high - low;
  const Float4 largest = Max4(high, -low);
  Bounds3f below_box = box;
  Bounds3f above_box = box;
  below_box.max[axis] = position;
  above_box.min[axis] = position;
  if (!IsResolved(extent, largest)) {
    const std::array<Vec3d, 3> exact = {Vec3d(corners[0]), Vec3d(corners[1]), Vec3d(corners[2])};
    return {Intersection(ClippedBounds(exact, below_box), bounds),
            Intersection(ClippedBounds(exact, above_box), bounds)};
  }

  const Float4 delta = Fill4(0x1p-21f) * extent + Fill4(0x1p-22f) * largest + Fill4(kUnderflow);
  const Float4 slack = Fill4(8) * delta;
  const Float4 box_low = {box.min.x, box.min.y, box.min.z, 0};
  const Float4 box_high = {box.max.x, box.max.y, box.max.z, 0};
  const Int4 leaves_low = low < box_low;
  const Int4 leaves_high = high > box_high;
  if (IsAny(leaves_low | leaves_high)) {
    const auto clip = [&](int k, float plane, float side) {
      ClipAtPlane(*polygon, k, plane, side, spare);
      std::swap(polygon, spare);
      return polygon->size != 0;
    };
    for (int k = 0; k < 3; ++k) {
      if ((leaves_low[k] != 0 && !clip(k, box.min[k] - slack[k], -1)) ||
          (leaves_high[k] != 0 && !clip(k, box.max[k] + slack[k], 1))) {
        return {Bounds3f::Empty(), Bounds3f::Empty()};
      }
    }
  }

  const float outward = slack[axis];
  HalfRange below(axis, position + outward, 1);
  HalfRange above(axis, position - outward, -1);
  Float4 previous = polygon->corners[polygon->size - 1];
  float previous_at = previous[axis];
  bool previous_below = below.IsInside(previous_at);
  bool previous_above = above.IsInside(previous_at);
  for (std::size_t i = 0; i < polygon->size; ++i) {
    const Float4 corner = polygon->corners[i];
    const Float4 edge = corner - previous;
    const float at = corner[axis];
    const bool is_below = below.IsInside(at);
    const bool is_above = above.IsInside(at);
    below.Add(previous, edge, previous_at, at - previous_at, previous_below, corner, is_below);
    above.Add(previous, edge, previous_at, at - previous_at, previous_above, corner, is_above);
    previous = corner;
    previous_at = at;
    previous_below = is_below;
    previous_above = is_above;
  }
  return {Common(below.low() - slack, below.high() + slack, bounds, below_box),
          Common(above.low() - slack, above.high() + slack, bounds, above_box)};
}

}  // namespace

ClippedHalves ClippedHalfBounds(const std::array<Vec3f, 3>& corners, const Bounds3f& box,
                                const Bounds3f& bounds, int axis, float position) {
  return HalfBounds(corners, box, bounds, axis, position);
}
ClippedHalves ClippedHalfBounds(const std::array<Vec3d, 3>& corners, const Bounds3f& box,
                                const Bounds3f& bounds, int axis, float position) {
  return HalfBounds(corners, box, bounds, axis, position);
}

}  // namespace kdray::core
