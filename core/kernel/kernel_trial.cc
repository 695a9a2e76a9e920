// SPDX-License-Identifier: Apache-2.0
#include "core/kernel/kernel_trial.h"

#include "core/kernel/kernel_choice.h"
#include "core/kernel/thread_clock.h"

namespace kdray::core {

namespace {

// Rays of the smallest batch with a trial, 32 blocks: if the stream kernel is half as fast, its
// half of two blocks costs a thirtieth of the batch's time.
constexpr std::size_t kWorthTrial = std::size_t{1} << 17;
// Of the interleaved kernel's time, what the stream kernel must stay below: times of half a block
// differ by a few percent.
constexpr double kClearlyFaster = 0.95;

}  // namespace

KernelTrial::KernelTrial(const KernelJob& job, bool may_try)
    : job_(job),
      tries_(may_try && job.kernel == KernelKind::kInterleaved && job.rays.size() >= kWorthTrial) {}

bool KernelTrial::Compare(std::size_t first, std::size_t last, bool stream_first) const {
  const auto seconds_of_ray = [&](KernelKind kernel, std::size_t from, std::size_t to) {
    KernelJob job = job_;
    job.kernel = kernel;
    const double start = ThreadSeconds();
    TraceBlock(job, from, to);
    return (ThreadSeconds() - start) / static_cast<double>(to - from);
  };
  const std::size_t middle = first + (last - first + 1) / 2;
  if (middle == last) {
    TraceBlock(job_, first, last);
    return false;
  }
  const auto one = stream_first ? KernelKind::kStream : KernelKind::kInterleaved;
  const auto other = stream_first ? KernelKind::kInterleaved : KernelKind::kStream;
  const double of_one = seconds_of_ray(one, first, middle);
  const double of_other = seconds_of_ray(other, middle, last);
  return stream_first ? of_one < kClearlyFaster * of_other : of_other < kClearlyFaster * of_one;
}

void KernelTrial::Trace(std::size_t first, std::size_t last) {
  if (!tries_) return TraceBlock(job_, first, last);
  const std::size_t block = blocks_.fetch_add(1, std::memory_order_relaxed);
  if (block >= 1 && block <= kComparisons) {
    if (Compare(first, last, block % 2 == 0)) won_.fetch_add(1, std::memory_order_relaxed);
    return;
  }
  KernelJob job = job_;
  if (won_.load(std::memory_order_relaxed) == kComparisons) job.kernel = KernelKind::kStream;
  TraceBlock(job, first, last);
}

}  // namespace kdray::core
