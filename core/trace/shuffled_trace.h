// SPDX-License-Identifier: Apache-2.0
// Traces shuffled batches, sorted in pieces or as they are, whichever a trial finds faster. Sorted
// rays share nodes and triangles; but their rows and answers then lie at random places, and a large
// piece of them does not stay in the second-level cache. On scans sorting doubles the speed, and
// large pieces have more similar rays. In rooms, where few nodes lie on a ray's way, reading rows
// at random may cost more than is gained.
#pragma once

#include <cstddef>
#include <functional>

#include "core/kernel/kernel.h"

namespace kdray::core {

/// Called when rows [first, last) have their answers, once for each row, from several threads.
using RowsTraced = std::function<void(std::size_t first, std::size_t last)>;

/// Traces all rows of a job that is to be sorted (KernelJob::sort), kSortedRays at a time. If
/// `may_try` and the batch is large, some rays are traced unsorted first, and some sorted in a
/// small piece. The others stay unsorted where that was faster. Else some are sorted in a larger
/// piece, and the others in pieces of the faster size. Answers do not depend on that, so the clock
/// decides only the speed. Works in parallel in the caller's arena. When job.cancel stops it, sets
/// *job.stopped.
void TraceShuffled(const KernelJob& job, bool may_try, const RowsTraced& traced);

}  // namespace kdray::core
