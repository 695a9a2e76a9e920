// The batch interface of ray queries: the one way in for server, renderer, tests and benchmarks.
// Kernels are chosen behind it; each only culls, and one leaf test per precision
// (core/intersect/triangle_intersection.h) decides.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "core/base/cancel.h"
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

  /// For tests and benchmarks; when absent, the rays and the processor decide. No answer depends on
  /// any of them. A level must be one of SupportedSimdLevels().
  std::optional<KernelKind> kernel = {};
  std::optional<SimdLevel> simd = {};
  std::optional<bool> sort = {};  ///< bring rays that are alike together before they are traced
};

/// Work done for one ray; what the `cost` picture shows. Depends on the build, unlike answers.
struct TraceCost {
  std::uint32_t nodes_visited = 0;
  std::uint32_t triangles_tested = 0;
};

/// hits[i] = the hit of rays[i] with the smallest t in [t_min, t_max], both ends included; at equal
/// t the smallest primitive_id. A miss is Hit{}; a ray that cannot be (IsValid) is a miss with t =
/// NaN. Each row depends on its ray and the mesh alone: not on its neighbours, the build, the
/// number of threads. hits.size() == rays.size(). Works in blocks, in parallel within the caller's
/// arena; looks at `cancel` by the work done, inside a ray too. Errors: kCancelled,
/// kDeadlineExceeded (hits are then unspecified). Safe from many threads at once.
Status TraceClosest(const Scene& scene, RayBatch rays, const TraceOptions& options,
                    std::span<Hit> hits);

/// occluded[i] = 1 exactly when TraceClosest would find a hit, else 0. Rays that cannot be are 0;
/// test them with IsValid.
Status TraceAny(const Scene& scene, RayBatch rays, const TraceOptions& options,
                std::span<std::uint8_t> occluded);

/// TraceClosest that also counts the work.
Status TraceCostly(const Scene& scene, RayBatch rays, const TraceOptions& options,
                   std::span<Hit> hits, std::span<TraceCost> costs);

/// The plain reference path for one ray.
Hit ClosestHit(const Scene& scene, const Ray& ray, Precision precision);
bool AnyHit(const Scene& scene, const Ray& ray, Precision precision);

}  // namespace kdray::core
