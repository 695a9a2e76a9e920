// SPDX-License-Identifier: Apache-2.0
// The arenas that queries compute in.
#pragma once

#include <cstddef>
#include <memory>
#include <mutex>
#include <utility>
#include <vector>

#include "core/base/parallel.h"

namespace kdray::server {

/// An arena for each query that runs, so no query waits for the threads of another: its own thread
/// always computes, and the worker threads, which all arenas share, move between arenas after each
/// piece of work. With one arena for all, a query would wait until a thread left it, which may be
/// at the end of a long render. Safe from many threads at once.
class QueryArenas {
 public:
  /// At most `threads` work for one query.
  explicit QueryArenas(int threads) : threads_(threads) {}
  int threads() const { return threads_; }

  /// core::Arena::Run in an arena that no other query uses meanwhile.
  template <class F>
  void Run(F&& f) {
    const Lease lease(this);
    lease.arena->Run(std::forward<F>(f));
  }

 private:
  struct Lease {
    explicit Lease(QueryArenas* arenas) : owner(arenas), arena(arenas->Take()) {}
    ~Lease() { owner->GiveBack(std::move(arena)); }
    Lease(const Lease&) = delete;
    Lease& operator=(const Lease&) = delete;

    QueryArenas* owner;
    std::unique_ptr<core::Arena> arena;
  };

  // Arenas are kept: to make one takes longer than a small query.
  std::unique_ptr<core::Arena> Take() {
    {
      const std::lock_guard lock(mutex_);
      if (!idle_.empty()) {
        std::unique_ptr<core::Arena> arena = std::move(idle_.back());
        idle_.pop_back();
        return arena;
      }
      ++made_;
      idle_.reserve(made_);  // so GiveBack() does not allocate
    }
    return std::make_unique<core::Arena>(threads_);
  }
  void GiveBack(std::unique_ptr<core::Arena> arena) {
    const std::lock_guard lock(mutex_);
    idle_.push_back(std::move(arena));
  }

  const int threads_;
  std::mutex mutex_;
  std::vector<std::unique_ptr<core::Arena>> idle_;
  std::size_t made_ = 0;
};

}  // namespace kdray::server
