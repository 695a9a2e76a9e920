// What a hit looks like.
#pragma once

#include "core/geometry/hit.h"
#include "core/geometry/triangle_mesh.h"
#include "core/geometry/vec3.h"
#include "core/render/color.h"

namespace kdray::core {

/// Unit normal of a triangle by the order of its corners (counter-clockwise seen from outside), in
/// world axes. A zero vector when double cannot tell it: for a degenerate triangle, and for one so
/// thin that its corners look collinear; never NaN.
Vec3d UnitNormal(const TriangleMesh& mesh, PrimitiveId id);

/// How much of a headlight's light a surface sends back to the eye: |cos| between the normal and
/// the viewing ray, two-sided (Lambert, 1760). 1 for a zero normal: such a triangle is no more than
/// a line in any picture, and black would look like a crack.
float HeadlightCosine(const Vec3d& unit_normal, const Vec3d& ray_direction);

/// A strong colour for a triangle number, sRGB: near numbers look different, and a number always
/// looks the same.
Rgb HashedColor(PrimitiveId id);

}  // namespace kdray::core
