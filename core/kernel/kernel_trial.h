// SPDX-License-Identifier: Apache-2.0
// Finds the faster kernel for unrelated rays by trying two: rays themselves do not tell how many
// nodes they share. In rooms, where large triangles lie in few nodes, the stream kernel is up to
// 1.6 times as fast as the interleaved one; on scans it takes up to twice the time.
#pragma once

#include <atomic>
#include <cstddef>

#include "core/kernel/kernel.h"

namespace kdray::core {

/// Traces the blocks of one batch. Answers do not depend on the kernel, so the clock decides only
/// the speed.
class KernelTrial {
 public:
  /// The job has a kernel (ChooseKernel). If `may_try`, another one is tried if that is the
  /// interleaved one and the batch is so large that a block by a slower kernel is negligible. The
  /// job must live as long as this does.
  KernelTrial(const KernelJob& job, bool may_try);

  /// As TraceBlock() of the job, which it is for batches without a trial. The first block is traced
  /// by the interleaved kernel; it finds the caches cold. The next two are traced by both kernels,
  /// half by each. Blocks that begin after these are done are traced by the stream kernel if it was
  /// faster on both, all others by the interleaved one. Safe from many threads at once.
  void Trace(std::size_t first, std::size_t last);

 private:
  /// Traces half of the rows by each kernel; returns whether the stream kernel is clearly faster.
  bool Compare(std::size_t first, std::size_t last, bool stream_first) const;

  static constexpr std::size_t kComparisons = 2;
  const KernelJob& job_;
  const bool tries_;
  std::atomic<std::size_t> blocks_{0};  // begun
  std::atomic<std::size_t> won_{0};     // comparisons, by the stream kernel
};

}  // namespace kdray::core
