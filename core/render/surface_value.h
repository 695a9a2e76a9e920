// SPDX-License-Identifier: Apache-2.0
// What a mesh file says about its surface besides triangles, as shading uses it.
#pragma once

#include <functional>

#include "core/geometry/hit.h"
#include "core/geometry/vec3.h"

namespace kdray::core {

/// A vector at a hit: of a triangle, with the weights of its second and third corner. NaN where the
/// file says nothing. Must be safe from many threads at once.
using SurfaceValue = std::function<Vec3d(PrimitiveId id, double u, double v)>;

}  // namespace kdray::core
