// The rays that the trade-off is measured with.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/base/cancel.h"
#include "core/base/result.h"
#include "core/geometry/ray.h"
#include "core/scene/scene.h"

namespace kdray::core {

/// From points of a sphere around the bounds to points within them: what happens on average.
std::vector<Ray> RandomRays(const TriangleMesh& mesh, std::size_t count, std::uint64_t seed);

/// Rays where rounding decides: at vertices (half of them and more), at points of edges (a
/// quarter), and within axis-parallel planes through vertices, where kd-trees like to split.
struct AimedRays {
  std::vector<Ray> rays;
  bool from_inside = false;  ///< all start strictly inside the mesh, so each must hit something
};

/// `closed`: look for points inside to start from. A point counts as inside when three random lines
/// through it cross the mesh an odd number of times on both sides, in exact arithmetic, and not
/// too near. Where none is found (a mesh
/// thinner than its coordinates resolve), and for meshes that are not closed, rays start anywhere
/// in the bounds and a little around them. Errors: kCancelled, kDeadlineExceeded.
Result<AimedRays> MakeAimedRays(const Scene& scene, bool closed, std::size_t count,
                                std::uint64_t seed, const CancelToken& cancel);

}  // namespace kdray::core
