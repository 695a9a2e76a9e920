// SPDX-License-Identifier: Apache-2.0
// The rays for measuring the trade-off.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/base/cancel.h"
#include "core/base/result.h"
#include "core/geometry/ray.h"
#include "core/scene/scene.h"

namespace kdray::core {

/// Rays from points of a sphere around the bounds to points within them: the average case.
std::vector<Ray> RandomRays(const TriangleMesh& mesh, std::size_t count, std::uint64_t seed);

/// Rays where rounding decides: at vertices (half of them and more), at points of edges (a
/// quarter), and within axis-parallel planes through vertices, where kd-trees like to split.
struct AimedRays {
  std::vector<Ray> rays;
  bool from_inside = false;  ///< all start strictly inside the mesh, so each must hit
};

/// `closed`: rays start at points inside the mesh. A point counts as inside if three random lines
/// through it cross the mesh an odd number of times on both sides, in exact arithmetic, and not too
/// near. If no such point is found (a mesh thinner than its coordinates resolve), and for meshes
/// that are not closed, rays start anywhere in the bounds and slightly outside. Errors: kCancelled,
/// kDeadlineExceeded.
Result<AimedRays> MakeAimedRays(const Scene& scene, bool closed, std::size_t count,
                                std::uint64_t seed, const CancelToken& cancel);

}  // namespace kdray::core
