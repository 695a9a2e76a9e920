#include "core/trace/trace.h"

#include <atomic>
#include <cassert>
#include <memory>
#include <vector>

#include "core/base/parallel.h"
#include "core/intersect/closest_search.h"
#include "core/kernel/kernel.h"
#include "core/kernel/kernel_choice.h"
#include "core/kernel/ray_order.h"
#include "core/kernel/scalar_search.h"
#include "core/trace/ray_chunks.h"

namespace kdray::core {
namespace {

// Rays that one thread takes at a time.
constexpr std::size_t kBlockRays = 4096;

// Counts the work of one ray.
struct CountCost {
  TraceCost* cost;
  void CountNode() { ++cost->nodes_visited; }
  void CountTriangles(std::size_t n) { cost->triangles_tested += static_cast<std::uint32_t>(n); }
};

Hit InvalidRow() {
  Hit hit;
  hit.t = std::numeric_limits<double>::quiet_NaN();
  return hit;
}

/// Both kinds of query: `job` has the memory of its answers; the rest is set here.
Status TraceByKernel(const Scene& scene, const RayBatch& rays, const TraceOptions& options,
                     KernelJob job) {
  const std::unique_ptr<const ScalarSearch> scalar =
      MakeScalarSearch(*scene.mesh, options.precision);
  std::atomic<bool> stopped{false};
  job.tree = &scene.tree->wide;
  job.mesh = scene.mesh.get();
  job.scalar = scalar.get();
  job.precision = options.precision;
  job.rays = rays;
  job.cancel = options.cancel;
  job.stopped = &stopped;
  ChooseKernel({options.kernel, options.simd, options.sort}, &job);
  if (job.sort) {
    ParallelFor(0, rays.size(), kSortedRays, [&](std::size_t first, std::size_t last) {
      if (stopped.load(std::memory_order_relaxed)) return;
      std::vector<std::uint32_t> rows(last - first);
      OrderRays(rays, scene.mesh->bounds(), job.hits != nullptr, first, rows);
      KernelJob sorted = job;
      sorted.rows = rows.data();
      ParallelFor(0, rows.size(), kBlockRays,
                  [&](std::size_t a, std::size_t b) { TraceBlock(sorted, a, b); });
    });
  } else {
    ParallelFor(0, rays.size(), kBlockRays,
                [&](std::size_t first, std::size_t last) { TraceBlock(job, first, last); });
  }
  if (stopped) return options.cancel.ToError();
  return {};
}

}  // namespace

Status TraceClosest(const Scene& scene, RayBatch rays, const TraceOptions& options,
                    std::span<Hit> hits) {
  assert(hits.size() == rays.size());
  KernelJob job;
  job.hits = hits.data();
  return TraceByKernel(scene, rays, options, job);
}

Status TraceAny(const Scene& scene, RayBatch rays, const TraceOptions& options,
                std::span<std::uint8_t> occluded) {
  assert(occluded.size() == rays.size());
  KernelJob job;
  job.occluded = occluded.data();
  return TraceByKernel(scene, rays, options, job);
}

Status TraceCostly(const Scene& scene, RayBatch rays, const TraceOptions& options,
                   std::span<Hit> hits, std::span<TraceCost> costs) {
  assert(hits.size() == rays.size() && costs.size() == rays.size());
  const auto binary = scene.tree->Binary(*scene.mesh, BuildOptions{options.cancel});
  if (!binary.ok()) return binary.error();
  const auto trace = [&](const auto& structure, const auto& corners, auto tag, std::size_t i,
                         CancelPoll* poll) {
    using Test = typename decltype(tag)::Type;
    costs[i] = {};
    hits[i] = InvalidRow();
    const Ray ray = rays[i];
    if (!IsValid(ray)) return;
    const std::optional<LocalRay> local = Test::MakeRay(ray, scene.mesh->frame());
    hits[i] =
        local ? FindClosest<Test>(structure, corners, *local, CountCost{&costs[i]}, poll) : Hit{};
  };
  return VisitIntersection(*scene.mesh, options.precision, [&](const auto& corners, auto tag) {
    return std::visit(
        [&](const auto& structure) {
          return ForEachRow(rays.size(), options.cancel, [&](std::size_t i, CancelPoll* poll) {
            trace(structure, corners, tag, i, poll);
          });
        },
        **binary);
  });
}

Hit ClosestHit(const Scene& scene, const Ray& ray, Precision precision) {
  CancelPoll never{CancelToken()};
  return ClosestHit(scene, ray, precision, &never);
}

Hit ClosestHit(const Scene& scene, const Ray& ray, Precision precision, CancelPoll* poll) {
  if (!IsValid(ray)) return InvalidRow();
  const std::unique_ptr<const ScalarSearch> scalar = MakeScalarSearch(*scene.mesh, precision);
  const std::optional<LocalRay> local = scalar->MakeRay(ray, scene.mesh->frame());
  return local ? scalar->Closest(*local, scene.tree->wide, poll) : Hit{};
}

bool AnyHit(const Scene& scene, const Ray& ray, Precision precision) {
  return ClosestHit(scene, ray, precision).IsHit();
}

}  // namespace kdray::core
