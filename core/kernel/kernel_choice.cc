// SPDX-License-Identifier: Apache-2.0
#include "core/kernel/kernel_choice.h"

#include "core/kernel/ray_order.h"

namespace kdray::core {

namespace {

// Size of a server's second-level cache; a tree that fits it needs no prefetching.
constexpr std::uint64_t kSecondLevelCache = std::uint64_t{1} << 20;
// Smallest batch for which sampling a few hundred rays is negligible.
constexpr std::size_t kWorthSorting = std::size_t{1} << 12;
// Batches with at most this many groups (of 32,768) are sorted first and use the stream kernel. By
// the rough estimate, the benchmark's shadow rays are in 190 to 260 groups, scattered rays from
// what a camera sees in 700 to 1,400, and random rays in 9,300 to 14,500.
constexpr double kMostGroups = 4096;

// Whether of some rays at least one begins where the next one does, as a camera's do.
bool ShareOrigins(const RayBatch& rays) {
  constexpr std::size_t kSamples = 16;
  for (std::size_t i = 0; i < kSamples && rays.size() >= 2; ++i) {
    const std::size_t at = (rays.size() - 2) * i / kSamples;
    if (rays[at].origin == rays[at + 1].origin) return true;
  }
  return false;
}

}  // namespace

void ChooseKernel(const KernelOverrides& overrides, KernelJob* job) {
  job->simd = overrides.simd.value_or(BestSimdLevel());
  job->prefetch = job->tree->bytes() > kSecondLevelCache;
  const bool shuffled = IsShuffled(job->rays, job->mesh->bounds());
  const bool is_large = job->rays.size() >= kWorthSorting;
  const bool grouped =
      shuffled && is_large && CountGroups(job->rays, job->mesh->bounds()) <= kMostGroups;
  const bool random = shuffled && is_large && !grouped;
  job->sort = overrides.sort.value_or(grouped);
  job->alike = (!shuffled || (grouped && job->sort)) && !overrides.kernel;
  const KernelKind otherwise = job->alike ? KernelKind::kStream : KernelKind::kInterleaved;
  // The frustum kernel soon detects rays that do not form a packet, and passes them on.
  const bool frustum = HasFrustum(job->query()) &&
                       (ShareOrigins(job->rays) || (job->query() == RayQuery::kAny && !random));
  job->kernel = overrides.kernel.value_or(frustum ? KernelKind::kFrustum : otherwise);
  // Of the filters it has only culls.
  const bool is_filtered =
      job->filter_options.starts_on_surface || job->filter_options.ends_on_surface;
  if (job->kernel == KernelKind::kFrustum && (is_filtered || !HasFrustum(job->query()))) {
    job->kernel = otherwise;
  }
}

void TraceBlock(const KernelJob& job, std::size_t first, std::size_t last) {
  if (job.stopped->load(std::memory_order_relaxed)) return;
  const KernelFunction trace =
      FindKernel(job.simd, job.kernel, job.precision, job.mesh->has_double_vertices(), job.query());
  CancelPoll poll(job.cancel);
  KernelJob own = job;
  own.poll = &poll;
  HitPieces::Rest rest;
  if (job.lists.pieces != nullptr) {
    rest = job.lists.pieces->Take();
    own.lists.rest = &rest;
  }
  trace(own, first, last);
  if (job.lists.pieces != nullptr) job.lists.pieces->GiveBack(rest);
  if (poll.stopped()) job.stopped->store(true, std::memory_order_relaxed);
}

}  // namespace kdray::core
