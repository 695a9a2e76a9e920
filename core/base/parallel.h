// The one seam for threads: nothing else in the project includes oneTBB. The same algorithms run on
// one thread, so that races and order effects can be ruled out. Results must never depend on how
// the work was split.
#pragma once

#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/parallel_invoke.h>
#include <oneapi/tbb/task_arena.h>

#include <cstddef>
#include <utility>

namespace kdray::core {

/// A bounded set of worker threads. Builds and queries use different arenas, so that neither
/// starves the other. The thread that calls Run() works too, and counts among `threads`.
class Arena {
 public:
  /// threads >= 1; 1 means: everything on the calling thread.
  explicit Arena(int threads) : arena_(threads), threads_(threads) {}

  /// Runs f inside the arena and waits; exceptions pass through. Work that the caller's thread
  /// steals while it waits belongs to this call only (isolation), so holding a lock across Run()
  /// cannot deadlock with other requests.
  template <class F>
  void Run(F&& f) {
    arena_.execute([&] { tbb::this_task_arena::isolate(std::forward<F>(f)); });
  }
  int threads() const { return threads_; }

 private:
  tbb::task_arena arena_;
  int threads_;
};

/// body(first, last) over [begin, end) in pieces of at most `grain`; in the arena that the caller
/// runs in.
template <class Body>
void ParallelFor(std::size_t begin, std::size_t end, std::size_t grain, const Body& body) {
  if (end <= begin) return;
  if (end - begin <= grain) {
    body(begin, end);
    return;
  }
  tbb::parallel_for(
      tbb::blocked_range<std::size_t>(begin, end, grain),
      [&](const tbb::blocked_range<std::size_t>& r) {
        for (std::size_t first = r.begin(); first < r.end(); first += grain) {
          body(first, first + grain < r.end() ? first + grain : r.end());
        }
      },
      tbb::simple_partitioner());
}

/// Runs both, possibly at the same time, and waits for both.
template <class F, class G>
void ParallelInvoke(F&& f, G&& g) {
  tbb::parallel_invoke(std::forward<F>(f), std::forward<G>(g));
}

}  // namespace kdray::core
