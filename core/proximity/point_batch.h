// SPDX-License-Identifier: Apache-2.0
// The points of a batch in a mesh's frame, and their rows in an order in which neighbours are near
// each other.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/geometry/bounds3.h"
#include "core/geometry/triangle_mesh.h"
#include "core/geometry/vec3.h"

namespace kdray::core {

/// False for an invalid point, which has a component that is not finite.
inline bool IsValidPoint(const Vec3d& point) { return IsFinite(point); }

/// Points that are sorted together; more make neighbours more similar.
inline constexpr std::size_t kSortedPoints = std::size_t{1} << 15;

/// Sorts the row numbers first .. first + out.size() - 1 of `points` by Morton order of a grid of
/// 128^3 cells over the bounds, enlarged by half their size on each side. Points outside map to the
/// nearest cell. The order is stable. O(n).
void OrderPoints(std::span<const Vec3d> points, const Bounds3d& bounds, std::size_t first,
                 std::span<std::uint32_t> out);

}  // namespace kdray::core
