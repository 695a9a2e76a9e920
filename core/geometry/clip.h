// The part of a triangle that lies in a box, as bounds that a tree may trust.
#pragma once

#include <array>

#include "core/geometry/bounds3.h"
#include "core/geometry/vec3.h"

namespace kdray::core {

/// Bounds of what the closed triangle and the closed box have in common: they contain every common
/// point, in spite of rounding, and lie inside both the box and the triangle's own bounds (rounded
/// outward to float). Empty only when there is no common point; a triangle that passes the box
/// within a few 2^-46 of its size may get bounds all the same. Corners are finite and at most 2^10
/// in size. Source: Sutherland and Hodgman, "Reentrant Polygon Clipping", CACM 17(1), 1974.
Bounds3f ClippedBounds(const std::array<Vec3d, 3>& corners, const Bounds3f& box);

/// Bounds of the triangle's parts in the two halves of a box.
struct ClippedHalves {
  Bounds3f below, above;
};

/// The same for both halves of a box that is cut at `position` across `axis`, within `bounds`,
/// which are known to contain what triangle and box have in common; much faster, and less tight
/// where clipping makes corners: 2^-18 in place of 2^-46. (Not for triangles that are so small
/// beside their coordinates that it would show.) `position` lies within the box.
ClippedHalves ClippedHalfBounds(const std::array<Vec3f, 3>& corners, const Bounds3f& box,
                                const Bounds3f& bounds, int axis, float position);
ClippedHalves ClippedHalfBounds(const std::array<Vec3d, 3>& corners, const Bounds3f& box,
                                const Bounds3f& bounds, int axis, float position);

}  // namespace kdray::core
