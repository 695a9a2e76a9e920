// SPDX-License-Identifier: Apache-2.0
// How deep a segment reaches into a triangle.
#pragma once

#include <array>

#include "core/geometry/ring_boxes.h"

namespace kdray::core {

/// The smallest height of a triangle; infinite when it cannot be computed.
double SmallestHeight(const Triangle2& triangle);

/// The largest distance from the triangle's boundary of a point of segment p, q inside the
/// triangle; 0 when the segment does not meet the triangle. An estimate: rounded, and at most 4
/// times too small. The triangle must be counterclockwise.
double ChordDepth(const Triangle2& triangle, Point2 p, Point2 q);

}  // namespace kdray::core
