// Background work in order of arrival, on a few threads of its own. They are no TBB workers, so a
// job may wait for memory or disk without holding up a query.
#pragma once

#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <list>
#include <map>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>
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

  /// A job that waits for what is no processor: another has its place while this lives. At the end
  /// there may be one more at work than there are places.
  class Aside {
   public:
    Aside(Aside&& other) noexcept
        : queue_(std::exchange(other.queue_, nullptr)), lane_(other.lane_) {}
    Aside& operator=(Aside&&) = delete;
    ~Aside() {
      if (queue_ != nullptr) queue_->StepBack(lane_);
    }

   private:
    friend class WorkQueue;
    Aside(WorkQueue* queue, Lane lane) : queue_(queue), lane_(lane) {}
    WorkQueue* queue_;
    Lane lane_;
  };

  /// At most `load_threads` + `build_threads` jobs are at work, and `aside_threads` stand aside.
  WorkQueue(int load_threads, int build_threads, int aside_threads);
  ~WorkQueue();  ///< as Stop

  /// Dropped without a trace after Stop. A job catches what it throws itself.
  void Submit(const Sha256Digest& key, Lane lane, std::function<void()> job);
  /// For a job of `lane` while it runs. nullopt when as many stand aside already as may.
  std::optional<Aside> StepAside(Lane lane);
  /// Drops what has not begun and waits for what has.
  void Stop();

 private:
  // The jobs of one key, as long as there are any.
  struct Line {
    std::size_t jobs = 0;
    bool is_busy = false;         // one of them runs
    std::uint64_t looked_at = 0;  // the latest look that met one of them
  };
  using Lines = std::map<Sha256Digest, Line>;
  struct Job {
    Lines::iterator line;
    Lane lane;
    std::function<void()> run;
  };
  void Work();
  void StepBack(Lane lane);
  std::list<Job>::iterator NextRunnable() noexcept;

  std::mutex mutex_;
  std::condition_variable changed_;
  std::list<Job> jobs_;
  Lines lines_;
  std::uint64_t looks_ = 0;
  // Without those that stand aside:
  int running_ = 0;
  int running_builds_ = 0;
  int aside_ = 0;
  const int max_running_, max_builds_, max_aside_;
  bool stopping_ = false;
  std::vector<std::thread> threads_;
};

}  // namespace kdray::core
