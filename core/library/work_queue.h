// SPDX-License-Identifier: Apache-2.0
// Background jobs in order of arrival, on separate threads. These are not TBB workers, so a job may
// wait for memory or disk without delaying queries.
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

/// Jobs of one key run one after the other, in order of arrival, so work on one mesh needs no other
/// lock. Safe from many threads at once.
class WorkQueue {
 public:
  /// Loads are short and requests wait for them, so they precede builds, and builds never use all
  /// threads.
  enum class Lane { kLoad, kBuild };

  /// For a job that waits without computing: another job uses its place during this object's life.
  /// After that, one job more than the limit may run for a while.
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

  /// At most `load_threads` + `build_threads` jobs run, and `aside_threads` are set aside.
  WorkQueue(int load_threads, int build_threads, int aside_threads);
  ~WorkQueue();  ///< as Stop

  /// Jobs after Stop are dropped. A job must catch its exceptions.
  void Submit(const Sha256Digest& key, Lane lane, std::function<void()> job);
  /// For a running job of `lane`. nullopt if `aside_threads` jobs are aside already.
  std::optional<Aside> StepAside(Lane lane);
  /// Drops jobs that have not begun and waits for running ones.
  void Stop();

 private:
  // The jobs of one key.
  struct Line {
    std::size_t jobs = 0;
    bool is_busy = false;         // one of them runs
    std::uint64_t looked_at = 0;  // the last search that saw one of them
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
  // Without jobs that are aside:
  int running_ = 0;
  int running_builds_ = 0;
  int aside_ = 0;
  const int max_running_, max_builds_, max_aside_;
  bool stopping_ = false;
  std::vector<std::thread> threads_;
};

}  // namespace kdray::core
