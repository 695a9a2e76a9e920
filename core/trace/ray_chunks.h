// SPDX-License-Identifier: Apache-2.0
// Splits a batch into chunks for the threads of the caller's arena.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>

#include "core/base/cancel_poll.h"
#include "core/base/parallel.h"
#include "core/base/result.h"

namespace kdray::core {

/// Rays that one thread takes at a time.
inline constexpr std::size_t kChunkRays = 64;

/// f(first, last, poll) for [0, count) in chunks that begin at multiples of kChunkRays, in
/// parallel. f counts its work in `poll`, and returns early when that stops. Errors: kCancelled,
/// kDeadlineExceeded; then some chunks are missing.
template <class F>
Status ForEachChunk(std::size_t count, const CancelToken& cancel, const F& f) {
  std::atomic<bool> stopped{false};
  ParallelFor(0, count, kChunkRays, [&](std::size_t first, std::size_t last) {
    if (stopped.load(std::memory_order_relaxed)) return;
    CancelPoll poll(cancel);
    f(first, last, &poll);
    if (poll.stopped()) stopped.store(true, std::memory_order_relaxed);
  });
  if (stopped) return cancel.ToError();
  return {};
}

/// The same for f(row, poll).
template <class F>
Status ForEachRow(std::size_t count, const CancelToken& cancel, const F& f) {
  return ForEachChunk(count, cancel, [&](std::size_t first, std::size_t last, CancelPoll* poll) {
    for (std::size_t row = first; row < last && !poll->Spend(1); ++row) f(row, poll);
  });
}

}  // namespace kdray::core
