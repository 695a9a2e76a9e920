// SPDX-License-Identifier: Apache-2.0
// The batch interface of ray queries for server, renderer, tests and benchmarks. It chooses a
// kernel, which only culls; one triangle intersection per precision
// (core/intersect/triangle_intersection.h) decides.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "core/base/cancel.h"
#include "core/base/cancel_poll.h"
#include "core/base/huge_pages.h"
#include "core/base/result.h"
#include "core/geometry/hit.h"
#include "core/geometry/ray.h"
#include "core/intersect/hit_filter.h"
#include "core/intersect/precision.h"
#include "core/kernel/kernel_kind.h"
#include "core/kernel/simd_level.h"
#include "core/scene/scene.h"

namespace kdray::core {

/// Rays that one thread takes at a time.
inline constexpr std::size_t kTracedRows = 4096;

struct TraceOptions {
  Precision precision = Precision::kWatertight;
  CancelToken cancel;

  /// For tests and benchmarks; by default the rays and the processor decide. No answer depends on
  /// these options. A level must be one of SupportedSimdLevels().
  std::optional<KernelKind> kernel = {};
  std::optional<SimdLevel> simd = {};
  std::optional<bool> sort = {};  ///< sort similar rays together before tracing

  /// Hits that do not count. All queries, kernels and precisions treat them as misses and go on
  /// after them.
  Cull cull = Cull::kNone;  ///< hits on these sides
  /// `t_min=auto`: the origin lies on the mesh, and no triangle whose plane is within
  /// `surface_offset` of it is hit.
  bool starts_on_surface = false;
  /// `t_max=auto`: the ray is the segment from the origin to origin + direction, so t is at most 1,
  /// and its end lies on the mesh, with the same rule.
  bool ends_on_surface = false;
  double surface_offset = 0;  ///< of SurfaceOffset(); finite and not negative

  /// For TraceClosest, TraceAny and TraceCount. Called with rows [first, last) when their answers
  /// are final and still in the cache, once for each row, from the threads that trace. After a stop
  /// it may be called with rows whose answers are unspecified.
  std::function<void(std::size_t first, std::size_t last)> traced = {};
};

/// The work for one ray, for the trade-off. Unlike answers, it depends on the build.
struct TraceCost {
  std::uint32_t nodes_visited = 0;
  std::uint32_t triangles_tested = 0;
};

/// hits[i] = the hit of rays[i] with the smallest t in [t_min, t_max], both ends included; at equal
/// t the smallest primitive_id. A miss is Hit{}; an invalid ray (IsValid) is a miss with t = NaN.
/// Each row depends only on its ray and the mesh: not on its neighbours, the build, or the number
/// of threads. hits.size() == rays.size(). Works in blocks, in parallel within the caller's arena;
/// polls `cancel` by work done, also within a ray. Errors: kCancelled, kDeadlineExceeded (hits are
/// then unspecified). Safe from many threads at once.
Status TraceClosest(const Scene& scene, RayBatch rays, const TraceOptions& options,
                    std::span<Hit> hits);

/// occluded[i] = 1 if TraceClosest finds a hit, else 0. Invalid rays give 0; test them with
/// IsValid.
Status TraceAny(const Scene& scene, RayBatch rays, const TraceOptions& options,
                std::span<std::uint8_t> occluded);

/// counts[i] = the number of triangles that rays[i] hits in [t_min, t_max], both ends included.
/// In `fast`, `watertight` and `double` these are all triangles that the intersection test accepts,
/// so a ray through a shared edge counts both. In `exact` they are the crossings
/// (ExactIntersection::OwnsCrossing): a ray through an edge or corner that triangles share crosses
/// exactly one of them, or, where it only touches the surface, none or two. So from strictly inside
/// a closed mesh their number is odd and from strictly outside even, for every ray. Invalid rays
/// give 0. counts.size() == rays.size(). The rest is as for TraceClosest.
Status TraceCount(const Scene& scene, RayBatch rays, const TraceOptions& options,
                  std::span<std::uint32_t> counts);

/// All hits of a batch, ray by ray.
struct AllHits {
  HugeVector<Hit> hits;
  std::vector<std::size_t> first;      ///< ray i has hits [first[i], first[i + 1])
  std::vector<std::size_t> truncated;  ///< rays that hit more than `max_hits` triangles, ascending
  /// The batch has more hits than `most_hits`; the lists are then empty.
  bool too_many = false;
};

/// The triangles that TraceCount counts, of each ray by t, at equal t by primitive_id; in `exact`
/// by the exact t. Only the nearest `max_hits` of a ray are kept. The work ends once more than
/// `most_hits` are found in all. Memory grows with the returned hits, and for each ray in work with
/// `max_hits`, however many triangles it hits. The rest is as for TraceClosest.
Result<AllHits> TraceAll(const Scene& scene, RayBatch rays, const TraceOptions& options,
                         std::size_t max_hits,
                         std::size_t most_hits = std::numeric_limits<std::size_t>::max());

/// TraceClosest that also counts work, on the binary tree.
Status TraceCostly(const Scene& scene, RayBatch rays, const TraceOptions& options,
                   std::span<Hit> hits, std::span<TraceCost> costs);

/// The plain reference implementation for one ray. With a poll, the result means nothing once the
/// poll has stopped.
Hit ClosestHit(const Scene& scene, const Ray& ray, Precision precision);
Hit ClosestHit(const Scene& scene, const Ray& ray, Precision precision, CancelPoll* poll);
bool AnyHit(const Scene& scene, const Ray& ray, Precision precision);

}  // namespace kdray::core
