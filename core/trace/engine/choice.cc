#include "core/trace/engine/choice.h"

#include "core/trace/engine/ray_order.h"

namespace kdray::core {

namespace {

// A second-level cache of today's servers; a tree that fits it needs no prefetching.
constexpr std::uint64_t kSecondLevelCache = std::uint64_t{1} << 20;
// What one request may expect of a third-level cache. Beyond it sorting pays for closest hits too,
// which take longer and so have less to gain.
constexpr std::uint64_t kThirdLevelCache = std::uint64_t{32} << 20;
constexpr std::size_t kWorthSorting = std::size_t{1} << 14;

}  // namespace

void ChooseEngines(const TraceOptions& options, EngineJob* job) {
  job->simd = options.simd.value_or(BestSimdLevel());
  job->prefetch = job->tree->bytes() > kSecondLevelCache;
  const bool shuffled = IsShuffled(job->rays, job->mesh->bounds());
  const bool any = job->occluded != nullptr;
  job->sort =
      options.sort.value_or(shuffled && job->rays.size() >= kWorthSorting &&
                            job->tree->bytes() > (any ? kSecondLevelCache : kThirdLevelCache));
  job->alike = !shuffled && !options.engine;
  // The frustum hands on whatever is no packet, and finds that out soon; it knows these precisions
  // only.
  const Engine otherwise = shuffled ? Engine::kWave : Engine::kHybrid;
  const bool frustum =
      job->precision == Precision::kFast || job->precision == Precision::kWatertight;
  job->engine = options.engine.value_or(frustum ? Engine::kFrustum : otherwise);
}

void TraceBlock(const EngineJob& job, std::size_t first, std::size_t last) {
  const bool any = job.occluded != nullptr;
  const EngineFunction trace =
      FindEngine(job.simd, job.engine, job.precision, job.mesh->has_double_vertices(), any);
  trace(job, first, last);
}

}  // namespace kdray::core
