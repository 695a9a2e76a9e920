// The batch interface of ray queries for server, renderer, tests and benchmarks. It chooses a
// kernel, which only culls; one triangle intersection per precision
// (core/intersect/triangle_intersection.h) decides.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "core/base/cancel.h"
#include "core/base/cancel_poll.h"
#include "core/base/result.h"
#include "core/geometry/hit.h"
#include "core/geometry/ray.h"
#include "core/intersect/precision.h"
#include "core/kernel/kernel_kind.h"
#include "core/kernel/simd_level.h"
#include "core/scene/scene.h"

namespace kdray::core {

struct TraceOptions {
  Precision precision = Precision::kWatertight;
  CancelToken cancel;

  /// For tests and benchmarks; by default the rays and the processor decide. No answer depends on
  /// these options. A level must be one of SupportedSimdLevels().
  std::optional<KernelKind> kernel = {};
  std::optional<SimdLevel> simd = {};
  std::optional<bool> sort = {};  ///< sort similar rays together before tracing
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

/// TraceClosest that also counts work, on the binary tree.
Status TraceCostly(const Scene& scene, RayBatch rays, const TraceOptions& options,
                   std::span<Hit> hits, std::span<TraceCost> costs);

/// The plain reference implementation for one ray. With a poll, the result means nothing once the
/// poll has stopped.
Hit ClosestHit(const Scene& scene, const Ray& ray, Precision precision);
Hit ClosestHit(const Scene& scene, const Ray& ray, Precision precision, CancelPoll* poll);
bool AnyHit(const Scene& scene, const Ray& ray, Precision precision);

}  // namespace kdray::core
