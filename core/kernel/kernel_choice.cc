#include "core/kernel/kernel_choice.h"

#include "core/kernel/ray_order.h"

namespace kdray::core {

namespace {

// A second-level cache of today's servers; a tree that fits it needs no prefetching.
constexpr std::uint64_t kSecondLevelCache = std::uint64_t{1} << 20;
// Of so many rays, looking at a few hundred takes no time that counts.
constexpr std::size_t kWorthSorting = std::size_t{1} << 12;
// Rays of so few groups are sorted and go through the hybrid. By the estimate, which is rough, the
// benchmark's shadow rays are in 190 to 260 groups of 32,768, scattered ones from what a camera
// sees in 700 to 1,400, and random ones in 9,300 to 14,500.
constexpr double kMostGroups = 4096;

}  // namespace

void ChooseEngines(const KernelOverrides& overrides, EngineJob* job) {
  job->simd = overrides.simd.value_or(BestSimdLevel());
  job->prefetch = job->tree->bytes() > kSecondLevelCache;
  const bool shuffled = IsShuffled(job->rays, job->mesh->bounds());
  const bool grouped = shuffled && job->rays.size() >= kWorthSorting &&
                       CountGroups(job->rays, job->mesh->bounds()) <= kMostGroups;
  job->sort = overrides.sort.value_or(grouped);
  job->alike = (!shuffled || (grouped && job->sort)) && !overrides.engine;
  // The frustum hands on whatever is no packet, and finds that out soon; it knows these precisions
  // only.
  const Engine otherwise = job->alike ? Engine::kHybrid : Engine::kWave;
  const bool frustum =
      job->precision == Precision::kFast || job->precision == Precision::kWatertight;
  job->engine = overrides.engine.value_or(frustum ? Engine::kFrustum : otherwise);
}

void TraceBlock(const EngineJob& job, std::size_t first, std::size_t last) {
  if (job.stopped->load(std::memory_order_relaxed)) return;
  const bool any = job.occluded != nullptr;
  const EngineFunction trace =
      FindEngine(job.simd, job.engine, job.precision, job.mesh->has_double_vertices(), any);
  CancelPoll poll(job.cancel);
  EngineJob own = job;
  own.poll = &poll;
  trace(own, first, last);
  if (poll.stopped()) job.stopped->store(true, std::memory_order_relaxed);
}

}  // namespace kdray::core
