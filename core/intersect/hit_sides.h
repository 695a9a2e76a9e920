// SPDX-License-Identifier: Apache-2.0
// The decisions of HitFilter for a triangle whose corners are at hand: a kernel has them in its
// block, and the way to the mesh's vertices is long.
#pragma once

#include <array>

#include "core/geometry/local_ray.h"
#include "core/geometry/ray.h"
#include "core/geometry/vec3.h"
#include "core/intersect/hit_filter.h"

namespace kdray::core {

/// SideMet for a triangle with these corners, which are the mesh's local ones.
int SideMet(const Ray& ray, const std::array<Vec3d, 3>& corners);

/// HitFilter::Keeps for a triangle with these corners, which are the mesh's local ones.
bool KeepsHit(const HitFilter::Options& options, const MeshFrame& frame, const Ray& ray,
              const std::array<Vec3d, 3>& corners);

}  // namespace kdray::core
