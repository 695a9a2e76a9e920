// SPDX-License-Identifier: Apache-2.0
// The closest point of a mesh for each point of a batch. It walks the wide tree that rays walk, so
// nothing more is built for it.
#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <span>

#include "core/base/cancel.h"
#include "core/base/cancel_poll.h"
#include "core/base/result.h"
#include "core/geometry/hit.h"
#include "core/geometry/vec3.h"
#include "core/kernel/simd_level.h"
#include "core/scene/scene.h"

namespace kdray::core {

/// Bound of the error of a distance in PointPrecision::kDouble, in units of the distance plus the
/// longest side of the mesh's bounds: of the answered distance against the smallest one, and
/// against that to the named triangle.
inline constexpr double kDistanceBound = 0x1p-44;

/// What decides which triangle is closest.
enum class PointPrecision : std::uint8_t {
  /// Distances in double, with the error kDistanceBound. Points farther than 64 mesh sizes are
  /// decided as in kExact, because double cannot tell the distances to neighbours apart.
  kDouble,
  /// The distances of the real numbers that were sent. Distance, point, u and v are the exact ones,
  /// rounded to the nearest double.
  kExact,
};

struct PointOptions {
  PointPrecision precision = PointPrecision::kDouble;
  CancelToken cancel;

  /// For tests and benchmarks; no answer depends on it. Must be one of SupportedSimdLevels().
  std::optional<SimdLevel> simd = {};
};

/// One row of a batch's answer. Without a closest point (an invalid point, or a mesh whose
/// triangles are all degenerate) primitive_id is kNoPrimitive, and the distance is NaN or infinite.
struct ClosestPoint {
  double distance = std::numeric_limits<double>::infinity();  ///< world units; never -0
  Vec3d point;                                                ///< world
  double u = 0;  ///< weight of the triangle's second corner, 0..1
  double v = 0;  ///< weight of its third corner, 0..1; the first has 1 - u - v
  PrimitiveId primitive_id = kNoPrimitive;

  bool IsFound() const { return primitive_id != kNoPrimitive; }
  friend bool operator==(const ClosestPoint&, const ClosestPoint&) = default;
};

/// answers[i] = the closest point of the mesh to points[i] (world units); at equal distance on the
/// triangle with the smallest number. Degenerate triangles take no part, as for rays. A distance
/// beyond the range of double is the largest finite one. An invalid point (IsValidPoint) has no
/// closest point and the distance NaN. Each row depends only on its point and the mesh: not on its
/// neighbours, the build, the processor, or the number of threads. answers.size() ==
/// points.size(). Works in parallel within the caller's arena; polls `cancel` by work done, also
/// within a point. Errors: kCancelled, kDeadlineExceeded (answers are then unspecified). Safe from
/// many threads at once. Expected O(log n) for a point near the surface; a point that is equally
/// far from many triangles takes them all.
Status FindClosestPoints(const Scene& scene, std::span<const Vec3d> points,
                         const PointOptions& options, std::span<ClosestPoint> answers);

/// on_surface[i] = 1 if points[i] lies exactly on a triangle, else 0. Otherwise as
/// FindClosestPoints; the precision does not matter.
Status FindOnSurface(const Scene& scene, std::span<const Vec3d> points, const PointOptions& options,
                     std::span<std::uint8_t> on_surface);

}  // namespace kdray::core
