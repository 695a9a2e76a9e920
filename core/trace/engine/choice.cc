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
// Sorted rays with so many in their group go through the hybrid; random rays of the benchmark's
// batches have 9 to 28, scattered ones from what a camera sees 69 to 95.
constexpr double kWorthGrouping = 40;

}  // namespace

void ChooseEngines(const TraceOptions& options, EngineJob* job) {
  job->simd = options.simd.value_or(BestSimdLevel());
  job->prefetch = job->tree->bytes() > kSecondLevelCache;
  const bool shuffled = IsShuffled(job->rays, job->mesh->bounds());
  const bool any = job->occluded != nullptr;
  const bool many = job->rays.size() >= kWorthSorting;
  const bool grouped =
      shuffled && many && RaysPerGroup(job->rays, job->mesh->bounds()) >= kWorthGrouping;
  const bool beyond_cache = job->tree->bytes() > (any ? kSecondLevelCache : kThirdLevelCache);
  job->sort = options.sort.value_or(grouped || (shuffled && many && beyond_cache));
  job->alike = (!shuffled || (grouped && job->sort)) && !options.engine;
  // The frustum hands on whatever is no packet, and finds that out soon; it knows these precisions
  // only.
  const Engine otherwise = job->alike ? Engine::kHybrid : Engine::kWave;
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
