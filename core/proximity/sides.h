// SPDX-License-Identifier: Apache-2.0
// Which side of a mesh's surface points are on, and their signed distances. Decided exactly, by the
// parity of crossings (core/trace).
#pragma once

#include <cstdint>
#include <span>

#include "core/base/result.h"
#include "core/geometry/vec3.h"
#include "core/proximity/closest_points.h"
#include "core/scene/scene.h"

namespace kdray::core {

enum class Side : std::int8_t { kUnknown = -1, kOutside = 0, kInside = 1 };

/// sides[i] = kInside if points[i] (world units) lies on the surface, or a ray from it crosses the
/// surface an odd number of times. So the orientation of triangles does not matter, and nested
/// shells alternate. Points outside the mesh's bounds are outside. If the mesh is not closed
/// (Scene::is_closed), the rays in three fixed directions must agree on the parity; otherwise, and
/// for an invalid point, the side is kUnknown. `options.precision` does not matter. Each row
/// depends only on its point and the mesh. sides.size() == points.size(). Works in parallel within
/// the caller's arena; polls `options.cancel` by work done. Errors: kCancelled, kDeadlineExceeded
/// (answers are then unspecified). Memory: some 150 bytes a point. Safe from many threads at once.
Status FindSides(const Scene& scene, std::span<const Vec3d> points, const PointOptions& options,
                 std::span<Side> sides);

/// distances[i] = that of FindClosestPoints, negative inside; 0 on the surface, NaN where the side
/// is unknown. Otherwise as FindSides.
Status FindSignedDistances(const Scene& scene, std::span<const Vec3d> points,
                           const PointOptions& options, std::span<double> distances);

}  // namespace kdray::core
