// SPDX-License-Identifier: Apache-2.0
// Conservative bounds of the part of a triangle that lies in a box.
#pragma once

#include <array>

#include "core/geometry/bounds3.h"
#include "core/geometry/vec3.h"

namespace kdray::core {

/// Bounds of the intersection of the closed triangle and the closed box. They contain every common
/// point, in spite of rounding, and lie inside both the box and the triangle's own bounds (rounded
/// outward to float). Empty only when there is no common point; a triangle that passes the box
/// within a few 2^-46 of its size may still get bounds. Corners must be finite and at most 2^10 in
/// size. Source: Sutherland and Hodgman, "Reentrant Polygon Clipping", CACM 17(1), 1974.
Bounds3f ClippedBounds(const std::array<Vec3d, 3>& corners, const Bounds3f& box);

/// Bounds of the triangle's parts in the two halves of a box.
struct ClippedHalves {
  Bounds3f below, above;
};

/// The same for both halves of a box that is cut at `position` across `axis`. `bounds` must contain
/// the intersection of triangle and box. Much faster than ClippedBounds, and less tight where
/// clipping creates corners: 2^-18 instead of 2^-46. (Triangles so small beside their coordinates
/// that this matters are clipped in double.) `position` must lie within the box.
ClippedHalves ClippedHalfBounds(const std::array<Vec3f, 3>& corners, const Bounds3f& box,
                                const Bounds3f& bounds, int axis, float position);
ClippedHalves ClippedHalfBounds(const std::array<Vec3d, 3>& corners, const Bounds3f& box,
                                const Bounds3f& bounds, int axis, float position);

}  // namespace kdray::core
