// SPDX-License-Identifier: Apache-2.0
// The best triangles for a closed path that crosses itself.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "core/geometry/cut_meter.h"
#include "core/geometry/predicates.h"

namespace kdray::core {

/// Longest path for which CutWithLeastArea() is worth its time: some 30 ms.
inline constexpr std::size_t kMaxLeastAreaCorners = 256;

/// Appends n - 2 triangles that use the n corners of a path in its order, so that together they
/// have its boundary, such that the sum of their areas is as small as it can be. Each point off the
/// path lies in as many triangles as the path goes around it, in either direction, if there are
/// such triangles at all. Areas are rounded. Less when the meter stops. n is at least 3. O(n^3)
/// time, O(n^2) memory. Source: G. T. Klincsek, "Minimal Triangulations of Polygonal Domains",
/// Annals of Discrete Mathematics 9, 1980 (with the length of the diagonals in place of areas).
void CutWithLeastArea(std::span<const Point2> path, CutMeter* meter,
                      std::vector<std::array<std::uint32_t, 3>>* triangles);

}  // namespace kdray::core
