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

}  // namespace kdray::core
