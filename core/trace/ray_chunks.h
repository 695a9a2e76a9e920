// Cuts a batch into pieces for the threads of the caller's arena.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>

#include "core/base/cancel.h"
#include "core/base/parallel.h"
#include "core/base/result.h"

namespace kdray::core {

/// Between chunks the clock is looked at: tracing one takes some 100 microseconds through a tree,
/// so a cancelled request ends promptly even in a box of many triangles.
inline constexpr std::size_t kChunkRays = 64;

/// f(first, last) for [0, count) in chunks that begin at multiples of kChunkRays, in parallel.
/// Errors: kCancelled, kDeadlineExceeded; then some chunks were left out.
template <class F>
Status ForEachChunk(std::size_t count, const CancelToken& cancel, const F& f) {
  constexpr std::size_t kBlockRays = 4096;  // what one thread takes at a time
  std::atomic<bool> stopped{false};
  ParallelFor(0, count, kBlockRays, [&](std::size_t first, std::size_t last) {
    for (std::size_t chunk = first; chunk < last; chunk += kChunkRays) {
      if (stopped.load(std::memory_order_relaxed)) return;
      if (cancel.ShouldStop()) {
        stopped.store(true, std::memory_order_relaxed);
        return;
      }
      f(chunk, std::min(last, chunk + kChunkRays));
    }
  });
  if (stopped) return cancel.ToError();
  return {};
}

}  // namespace kdray::core
