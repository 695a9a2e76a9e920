// SPDX-License-Identifier: Apache-2.0
// core/base/parallel.h on oneTBB. Included by it alone.
#pragma once

#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/parallel_invoke.h>
#include <oneapi/tbb/task_arena.h>

#include <cstddef>
#include <utility>

namespace kdray::core::parallel_backend {

class Workers {
 public:
  explicit Workers(int threads) : arena_(threads) {}
  template <class F>
  void Run(F&& f) {
    arena_.execute([&] { tbb::this_task_arena::isolate(std::forward<F>(f)); });
  }

 private:
  tbb::task_arena arena_;
};

template <class Task>
void ForEach(std::size_t count, const Task& task) {
  tbb::parallel_for(
      tbb::blocked_range<std::size_t>(0, count, 1),
      [&](const tbb::blocked_range<std::size_t>& range) {
        for (std::size_t i = range.begin(); i < range.end(); ++i) task(i);
      },
      tbb::simple_partitioner());
}

template <class F, class G>
void Both(F&& f, G&& g) {
  tbb::parallel_invoke(std::forward<F>(f), std::forward<G>(g));
}

}  // namespace kdray::core::parallel_backend
