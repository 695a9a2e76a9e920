// SPDX-License-Identifier: Apache-2.0
// The one seam for threads: nothing else in the project sees oneTBB. The same algorithms run on one
// thread, so that races and order effects can be ruled out. Results must never depend on how the
// work was split.
#pragma once

#include <cstddef>
#include <utility>

#ifdef __SANITIZE_THREAD__
#include "core/base/parallel_threads.h"
#else
#include "core/base/parallel_tbb.h"
#endif

namespace kdray::core {

/// A bounded set of worker threads. Builds and queries use different arenas, so that neither
/// starves the other. The thread that calls Run() works too, and counts among `threads`.
class Arena {
 public:
  /// threads >= 1; 1 means: everything on the calling thread.
  explicit Arena(int threads) : workers_(threads), threads_(threads) {}

  /// Runs f inside the arena and waits; exceptions pass through. Work that the caller's thread
  /// steals while it waits belongs to this call only (isolation), so holding a lock across Run()
  /// cannot deadlock with other requests.
  template <class F>
  void Run(F&& f) {
    workers_.Run(std::forward<F>(f));
  }
  int threads() const { return threads_; }

 private:
  parallel_backend::Workers workers_;
  int threads_;
};

/// body(first, last) over [begin, end) in pieces that begin at multiples of `grain` behind `begin`
/// and are `grain` long, the last one shorter; in the arena that the caller runs in. Exceptions
/// pass through.
template <class Body>
void ParallelFor(std::size_t begin, std::size_t end, std::size_t grain, const Body& body) {
  if (end <= begin) return;
  const std::size_t pieces = (end - begin - 1) / grain + 1;
  const auto run_piece = [&](std::size_t piece) {
    const std::size_t first = begin + piece * grain;
    body(first, end - first < grain ? end : first + grain);
  };
  if (pieces == 1) {
    run_piece(0);
  } else {
    parallel_backend::ForEach(pieces, run_piece);
  }
}

/// Runs both, possibly at the same time, and waits for both. Exceptions pass through.
template <class F, class G>
void ParallelInvoke(F&& f, G&& g) {
  parallel_backend::Both(std::forward<F>(f), std::forward<G>(g));
}

}  // namespace kdray::core
