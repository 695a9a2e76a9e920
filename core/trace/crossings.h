// All crossings of a ray with a mesh, and their number, for parity and inside tests. Always in the
// precision `exact`; the others may count an edge twice or not at all.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/base/cancel.h"
#include "core/base/result.h"
#include "core/geometry/hit.h"
#include "core/geometry/ray.h"
#include "core/scene/scene.h"

namespace kdray::core {

// A crossing is a triangle that meets the ray moved by an infinitely small amount
// (ExactIntersection::OwnsCrossing): a ray through an edge or corner that triangles share crosses
// exactly one of them, or, where it only touches the surface, none or two; one that runs along a
// triangle does not cross it. So from strictly inside a closed mesh the number of crossings is odd
// and from strictly outside even, for every ray. Each crossing has the t of the ray as given, which
// must lie in [t_min, t_max], both ends included. A ray crosses a triangle at most once. As in
// core/trace/trace.h, an invalid ray crosses nothing, rows depend only on their ray and the mesh,
// the work runs in parallel within the caller's arena, and errors are kCancelled and
// kDeadlineExceeded.

/// counts[i] = number of crossings of rays[i]. counts.size() == rays.size(). Safe from many threads
/// at once.
Status TraceCount(const Scene& scene, RayBatch rays, const CancelToken& cancel,
                  std::span<std::uint32_t> counts);

/// The crossings of a batch, ray by ray.
struct Crossings {
  std::vector<Hit> hits;
  std::vector<std::size_t> first;      ///< ray i has hits [first[i], first[i + 1])
  std::vector<std::size_t> truncated;  ///< rays with more than `max_hits` crossings, ascending
};

/// The crossings of each ray by the exact t, at equal t by primitive_id; the nearest `max_hits` of
/// them. Memory grows with the returned crossings. Safe from many threads at once.
Result<Crossings> TraceAll(const Scene& scene, RayBatch rays, std::size_t max_hits,
                           const CancelToken& cancel);

}  // namespace kdray::core
