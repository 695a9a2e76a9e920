// SPDX-License-Identifier: Apache-2.0
#include "core/trace/shuffled_trace.h"

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <vector>

#include "core/base/parallel.h"
#include "core/kernel/kernel_choice.h"
#include "core/kernel/ray_order.h"
#include "core/kernel/thread_clock.h"
#include "core/trace/trace.h"

namespace kdray::core {

namespace {

// Rays of the trial. Those of a small piece and their answers fit a second-level cache.
constexpr std::size_t kUnsortedRays = std::size_t{1} << 12;
constexpr std::size_t kSmallPiece = std::size_t{1} << 14;
constexpr std::size_t kLargePiece = std::size_t{1} << 16;
// Rays of the smallest batches with a trial, and with one of a large piece. Where unsorted rays
// take twice the time, those of the trial cost at most a twelfth of the batch's.
constexpr std::size_t kWorthTrial = std::size_t{3} << 15;
constexpr std::size_t kWorthLargeTrial = std::size_t{1} << 18;
// Of a larger tree, unrelated rays read nodes from memory, not from a cache: sorting pays.
constexpr std::uint64_t kLargestTree = std::uint64_t{32} << 20;
// Of the other's time, what a way must stay below: times of a piece differ by a few percent.
constexpr double kClearlyFaster = 0.95;
// The same of the first rays, which find the caches cold.
constexpr double kMayBeFaster = 1.3;

class ShuffledTrace {
 public:
  ShuffledTrace(const KernelJob& job, const RowsTraced& traced) : job_(job), traced_(traced) {}

  void Run(bool may_try) {
    const std::size_t size = job_.rays.size();
    std::size_t first = 0;
    std::size_t piece = kSortedRays;
    if (may_try && size >= kWorthTrial && job_.tree->bytes() <= kLargestTree) {
      const auto unsorted = [&] {
        first += kUnsortedRays;
        return TraceUnsorted(first - kUnsortedRays, first);
      };
      const auto sorted = [&](std::size_t count) {
        first += count;
        return TraceSorted(first - count, first);
      };
      const double cold = unsorted();
      const Seconds small = sorted(kSmallPiece);
      const double with_sort = small.sort + small.trace;
      if (cold < kMayBeFaster * with_sort && unsorted() < kClearlyFaster * with_sort) {
        TraceUnsorted(first, size);
        return;
      }
      if (size >= kWorthLargeTrial) {
        const Seconds large = sorted(kLargePiece);
        if (small.trace < kClearlyFaster * large.trace) piece = kSmallPiece;
      }
    }
    ParallelFor(first, size, piece,
                [&](std::size_t from, std::size_t to) { TraceSorted(from, to); });
  }

 private:
  // Of one ray.
  struct Seconds {
    double sort = 0;  // on the calling thread
    double trace = 0;
  };

  /// Returns the seconds of one ray.
  double TraceUnsorted(std::size_t first, std::size_t last) {
    KernelJob job = job_;
    job.kernel = KernelKind::kStream;
    return TraceBlocks(job, first, last, traced_);
  }

  Seconds TraceSorted(std::size_t first, std::size_t last) {
    if (job_.stopped->load(std::memory_order_relaxed)) return {};
    Seconds seconds;
    std::vector<std::uint32_t> rows(last - first);
    const double start = ThreadSeconds();
    const bool by_direction = job_.query() != RayQuery::kAny;
    OrderRays(job_.rays, job_.mesh->bounds(), by_direction, first, rows);
    seconds.sort = (ThreadSeconds() - start) / static_cast<double>(rows.size());
    KernelJob sorted = job_;
    sorted.rows = rows.data();
    seconds.trace = TraceBlocks(sorted, 0, rows.size(), [](std::size_t, std::size_t) {});
    ParallelFor(first, last, kTracedRows, traced_);
    return seconds;
  }

  /// Entries [first, last) of the job. Returns the seconds of one, on any thread.
  template <class Traced>
  static double TraceBlocks(const KernelJob& job, std::size_t first, std::size_t last,
                            const Traced& traced) {
    std::atomic<double> seconds{0};
    ParallelFor(first, last, kTracedRows, [&](std::size_t from, std::size_t to) {
      const double start = ThreadSeconds();
      TraceBlock(job, from, to);
      seconds.fetch_add(ThreadSeconds() - start, std::memory_order_relaxed);
      traced(from, to);
    });
    return seconds / static_cast<double>(last - first);
  }

  const KernelJob& job_;
  const RowsTraced& traced_;
};

}  // namespace

void TraceShuffled(const KernelJob& job, bool may_try, const RowsTraced& traced) {
  ShuffledTrace(job, traced).Run(may_try);
}

}  // namespace kdray::core
