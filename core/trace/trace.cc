// SPDX-License-Identifier: Apache-2.0
#include "core/trace/trace.h"

#include <algorithm>
#include <atomic>
#include <cassert>
#include <limits>
#include <memory>
#include <vector>

#include "core/base/parallel.h"
#include "core/intersect/closest_search.h"
#include "core/kernel/kernel.h"
#include "core/kernel/kernel_choice.h"
#include "core/kernel/kernel_trial.h"
#include "core/kernel/ray_hits.h"
#include "core/kernel/ray_order.h"
#include "core/kernel/scalar_search.h"
#include "core/trace/ray_chunks.h"
#include "core/trace/shuffled_trace.h"

namespace kdray::core {
namespace {

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

HitFilter::Options FilterOf(const TraceOptions& options) {
  return {options.cull, options.starts_on_surface, options.ends_on_surface, options.surface_offset};
}

/// Traces the job's rays, whose choices are made; by the caller if `is_given`. Calls
/// traced(first, last) as TraceOptions::traced says.
void TraceInBlocks(const KernelJob& job, bool is_given, const RowsTraced& traced) {
  if (job.sort) return TraceShuffled(job, !is_given, traced);
  KernelTrial trial(job, !is_given);
  ParallelFor(0, job.rays.size(), kTracedRows, [&](std::size_t first, std::size_t last) {
    trial.Trace(first, last);
    traced(first, last);
  });
}

/// A ray that ends at t = 1 at the latest. Where that leaves nothing of the interval of a valid
/// ray, the ray stays valid and misses.
template <class T>
RayOf<T> CutAtOne(RayOf<T> ray) {
  if (!(ray.t_max > 1)) return ray;
  if (ray.t_min > 1) {
    ray.t_min = std::numeric_limits<T>::infinity();  // no hit has this t
    ray.t_max = ray.t_min;
  } else {
    ray.t_max = 1;
  }
  return ray;
}

/// f(cut rays, first row) for pieces of the batch, in parallel, with every ray cut at t = 1.
template <class F>
void ForEachCutPiece(const RayBatch& rays, const F& f) {
  const auto with = [&]<class T>(const RayOf<T>* given) {
    ParallelFor(0, rays.size(), kSortedRays, [&](std::size_t first, std::size_t last) {
      std::vector<RayOf<T>> cut(given + first, given + last);
      for (RayOf<T>& ray : cut) ray = CutAtOne(ray);
      f(RayBatch(std::span<const RayOf<T>>(cut)), first);
    });
  };
  if (rays.floats() != nullptr) return with(rays.floats());
  with(rays.doubles());
}

/// Every kind of query: `job` has the memory of its answers; the rest is set here.
Status TraceByKernel(const Scene& scene, const RayBatch& rays, const TraceOptions& options,
                     const CancelToken& cancel, KernelJob job) {
  job.filter_options = FilterOf(options);
  const HitFilter filter(*scene.mesh, job.filter_options);
  job.filter = filter.is_active() ? &filter : nullptr;
  const std::unique_ptr<const ScalarSearch> scalar =
      MakeScalarSearch(*scene.mesh, options.precision, job.filter);
  std::atomic<bool> stopped{false};
  job.tree = &scene.tree->wide;
  job.has_repeats = scene.tree->build != BuildKind::kBvh && scene.tree->build != BuildKind::kBox;
  job.mesh = scene.mesh.get();
  job.scalar = scalar.get();
  job.precision = options.precision;
  job.rays = rays;
  job.cancel = cancel;
  job.stopped = &stopped;
  const KernelOverrides overrides{options.kernel, options.simd, options.sort};
  const bool is_given = options.kernel.has_value() || options.sort.has_value();
  const auto traced = [&options](std::size_t first, std::size_t last) {
    if (options.traced) options.traced(first, last);
  };
  if (options.ends_on_surface) {
    ForEachCutPiece(rays, [&](const RayBatch& cut, std::size_t first) {
      KernelJob piece = job;
      piece.rays = cut;
      if (piece.hits != nullptr) piece.hits += first;
      if (piece.occluded != nullptr) piece.occluded += first;
      if (piece.counts != nullptr) piece.counts += first;
      if (piece.lists.rows != nullptr) piece.lists.rows += first;
      ChooseKernel(overrides, &piece);
      TraceInBlocks(piece, is_given,
                    [&](std::size_t a, std::size_t b) { traced(first + a, first + b); });
    });
  } else {
    ChooseKernel(overrides, &job);
    TraceInBlocks(job, is_given, traced);
  }
  if (stopped) return cancel.ToError();
  return {};
}

}  // namespace

Status TraceClosest(const Scene& scene, RayBatch rays, const TraceOptions& options,
                    std::span<Hit> hits) {
  assert(hits.size() == rays.size());
  KernelJob job;
  job.hits = hits.data();
  return TraceByKernel(scene, rays, options, options.cancel, job);
}

Status TraceAny(const Scene& scene, RayBatch rays, const TraceOptions& options,
                std::span<std::uint8_t> occluded) {
  assert(occluded.size() == rays.size());
  KernelJob job;
  job.occluded = occluded.data();
  return TraceByKernel(scene, rays, options, options.cancel, job);
}

Status TraceCount(const Scene& scene, RayBatch rays, const TraceOptions& options,
                  std::span<std::uint32_t> counts) {
  assert(counts.size() == rays.size());
  std::fill(counts.begin(), counts.end(), 0u);
  KernelJob job;
  job.counts = counts.data();
  return TraceByKernel(scene, rays, options, options.cancel, job);
}

Result<AllHits> TraceAll(const Scene& scene, RayBatch rays, const TraceOptions& options,
                         std::size_t max_hits, std::size_t most_hits) {
  HitPieces pieces;
  std::vector<HitRow> rows(rays.size());
  std::atomic<std::size_t> total{0};
  KernelJob job;
  job.lists = {max_hits, rows.data(), &pieces, nullptr, &total};
  const CancelToken limited = CancelToken::When([&] {
    return options.cancel.ShouldStop() || total.load(std::memory_order_relaxed) > most_hits;
  });
  const Status status = TraceByKernel(scene, rays, options, limited, job);
  AllHits all;
  if (!status.ok()) {
    if (options.cancel.ShouldStop()) return options.cancel.ToError();
    all.too_many = true;
    return all;
  }

  all.first.reserve(rays.size() + 1);
  all.first.push_back(0);
  for (std::size_t i = 0; i < rays.size(); ++i) {
    all.first.push_back(all.first.back() + rows[i].size);
    if (rows[i].is_truncated) all.truncated.push_back(i);
  }
  if (all.first.back() > most_hits) {
    all = {};
    all.too_many = true;
    return all;
  }
  all.hits.resize(all.first.back());
  const Status joined = ForEachChunk(
      rays.size(), options.cancel, [&](std::size_t first, std::size_t last, CancelPoll* poll) {
        for (std::size_t i = first; i < last && !poll->Spend(1 + rows[i].size); ++i) {
          std::copy_n(rows[i].hits, rows[i].size,
                      all.hits.begin() + static_cast<std::ptrdiff_t>(all.first[i]));
        }
      });
  if (!joined.ok()) return joined.error();
  return all;
}

Status TraceCostly(const Scene& scene, RayBatch rays, const TraceOptions& options,
                   std::span<Hit> hits, std::span<TraceCost> costs) {
  assert(hits.size() == rays.size() && costs.size() == rays.size());
  const auto binary = scene.tree->Binary(*scene.mesh, BuildOptions{options.cancel});
  if (!binary.ok()) return binary.error();
  const HitFilter filter(*scene.mesh, FilterOf(options));
  const auto trace = [&](const auto& structure, const auto& corners, auto tag, std::size_t i,
                         CancelPoll* poll) {
    using Test = typename decltype(tag)::Type;
    costs[i] = {};
    hits[i] = InvalidRow();
    Ray ray = rays[i];
    if (!IsValid(ray)) return;
    if (options.ends_on_surface) ray = CutAtOne(ray);
    const std::optional<LocalRay> local = Test::MakeRay(ray, scene.mesh->frame());
    hits[i] =
        local ? FindClosest<Test>(structure, corners, *local, &filter, CountCost{&costs[i]}, poll)
              : Hit{};
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
