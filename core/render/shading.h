// SPDX-License-Identifier: Apache-2.0
// The appearance of a hit.
#pragma once

#include <algorithm>
#include <cmath>

#include "core/geometry/bounds3.h"
#include "core/geometry/hit.h"
#include "core/geometry/triangle_mesh.h"
#include "core/geometry/vec3.h"
#include "core/render/color.h"

namespace kdray::core {

/// Unit normal of a triangle by the order of its corners (counter-clockwise seen from outside), in
/// world axes. A zero vector if double cannot resolve it: for a degenerate triangle, and for one so
/// thin that its corners are collinear in double. Never NaN.
Vec3d UnitNormal(const TriangleMesh& mesh, PrimitiveId id);

/// The share of a headlight's light that a surface reflects to the eye: |cos| between the normal
/// and the viewing ray, two-sided (Lambert, 1760). 1 for a zero normal: such a triangle is at most
/// a line in a picture, and black would look like a crack.
template <class T>
float HeadlightCosine(const Vec3<T>& unit_normal, const Vec3<T>& ray_direction) {
  if (unit_normal == Vec3<T>{}) return 1.0f;
  const T cosine = std::abs(Dot(unit_normal, ray_direction)) / Length(ray_direction);
  return static_cast<float>(std::min(cosine, T(1)));
}

/// The length of a box's diagonal, at any scale.
double DiagonalOf(const Bounds3d& bounds);

/// How far ambient occlusion looks for what hides the surroundings, world units: a tenth of the
/// diagonal, so that folds and contacts darken and open hollows do not.
double DefaultAoRadius(const Bounds3d& bounds);

/// A saturated colour for a triangle number, sRGB. Nearby numbers have different colours, and a
/// number always has the same.
Rgb HashedColor(PrimitiveId id);

}  // namespace kdray::core
