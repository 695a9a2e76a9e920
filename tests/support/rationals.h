// SPDX-License-Identifier: Apache-2.0
// The oracle of the precision `exact`: rays and triangles in rational numbers throughout, by
// solving for the plane and then the weights, on world coordinates. It shares nothing with what it
// judges and is as slow as it is obvious.
#pragma once

#include <gmpxx.h>

#include <array>
#include <optional>

#include "core/geometry/hit.h"
#include "core/geometry/ray.h"
#include "core/geometry/triangle_mesh.h"

namespace kdray::test {

using TriangleCorners = std::array<core::Vec3d, 3>;  // world

TriangleCorners CornersOf(const core::MeshData& data, core::PrimitiveId id);

/// Where the ray's whole line meets the closed triangle; nothing when it misses, or is parallel to
/// the triangle's plane.
std::optional<mpq_class> RationalHit(const core::Ray& ray, const TriangleCorners& triangle);

/// The t that is answered for an exact one: rounded to the nearest double, ties to even, and the
/// largest finite one beyond the range of double.
double RoundedToNearest(const mpq_class& t);

/// Whether the t that is answered lies in [t_min, t_max].
bool IsInInterval(const core::Ray& ray, const mpq_class& t);

/// Of the second and third corner, where the ray's line meets the triangle's plane.
struct RationalWeights {
  mpq_class u, v;
};
RationalWeights WeightsOf(const core::Ray& ray, const TriangleCorners& triangle);

struct RationalClosestHit {
  core::PrimitiveId primitive_id = core::kNoPrimitive;
  mpq_class t;  ///< of a hit
};
/// Smallest t, then smallest id, over all triangles.
RationalClosestHit RationalClosest(const core::MeshData& data, const core::Ray& ray);

/// Triangles that the ray crosses once its origin is moved by (e, e^2, e^3), with the t of the ray
/// as given. For e so small that the moved ray passes every edge on the side that an infinitely
/// small e would; asserts that it meets none.
std::size_t RationalCrossings(const core::MeshData& data, const core::Ray& ray, const mpq_class& e);

/// The squared distance of a point and the closed triangle: of the corners, of the edges that have
/// the point between their ends, and of the plane if the point is above the triangle, the smallest.
mpq_class RationalSquaredDistance(const core::Vec3d& point, const TriangleCorners& triangle);

struct RationalClosestPoint {
  core::PrimitiveId primitive_id = core::kNoPrimitive;
  mpq_class square;  ///< of the distance
};
/// Smallest distance, then smallest id, over all triangles with an area.
RationalClosestPoint RationalClosestTo(const core::MeshData& data, const core::Vec3d& point);

/// Whether `root` is the square root of `square`, rounded to the nearest double.
bool IsRoundedRoot(double root, const mpq_class& square);

}  // namespace kdray::test
