// Background work in order of arrival, on a few threads of its own. They are no TBB workers, so a
// job may wait for memory or disk without holding up a query.
#pragma once

#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <list>
#include <mutex>
#include <set>
#include <thread>
#include <vector>

#include "core/base/hash.h"

namespace kdray::core {

/// Jobs of one key never run at the same time and run in order of arrival, so what concerns one
/// mesh needs no further care. Safe from many threads at once.
class WorkQueue {
 public:
  /// Loads are short and somebody waits for them, so they go before builds, and builds never take
  /// all the threads.
  enum class Lane { kLoad, kBuild };

  WorkQueue(int load_threads, int build_threads);
  ~WorkQueue();  ///< as Stop

  /// Dropped without a trace after Stop.
  void Submit(const Sha256Digest& key, Lane lane, std::function<void()> job);
  /// Drops what has not begun and waits for what has.
  void Stop();

 private:
  struct Job {
    Sha256Digest key;
    Lane lane;
    std::function<void()> run;
  };
  void Work();
  std::list<Job>::iterator NextRunnable();

  std::mutex mutex_;
  std::condition_variable changed_;
  std::list<Job> jobs_;
  std::set<Sha256Digest> busy_keys_;
  int running_builds_ = 0;
  const int max_builds_;
  bool stopping_ = false;
  std::vector<std::thread> threads_;
};

}  // namespace kdray::core
