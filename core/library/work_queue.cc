// SPDX-License-Identifier: Apache-2.0
#include "core/library/work_queue.h"

#include <utility>

namespace kdray::core {

WorkQueue::WorkQueue(int load_threads, int build_threads, int aside_threads)
    : max_running_(load_threads + build_threads),
      max_builds_(build_threads),
      max_aside_(aside_threads) {
  const int threads = max_running_ + max_aside_;
  threads_.reserve(static_cast<std::size_t>(threads));
  try {
    for (int i = 0; i < threads; ++i) threads_.emplace_back([this] { Work(); });
  } catch (...) {
    Stop();  // waits for running jobs
    throw;
  }
}

WorkQueue::~WorkQueue() { Stop(); }

void WorkQueue::Submit(const Sha256Digest& key, Lane lane, std::function<void()> job) {
  std::list<Job> added;
  added.push_back({Lines::iterator(), lane, std::move(job)});
  const std::lock_guard lock(mutex_);
  if (stopping_) return;
  const Lines::iterator line = lines_.try_emplace(key).first;
  // From here on nothing is allocated, nor where jobs are selected and ended.
  ++line->second.jobs;
  added.front().line = line;
  jobs_.splice(jobs_.end(), added);
  changed_.notify_all();
}

std::optional<WorkQueue::Aside> WorkQueue::StepAside(Lane lane) {
  const std::lock_guard lock(mutex_);
  if (aside_ >= max_aside_) return std::nullopt;
  ++aside_;
  --running_;
  running_builds_ -= lane == Lane::kBuild ? 1 : 0;
  changed_.notify_all();
  return Aside(this, lane);
}

void WorkQueue::StepBack(Lane lane) {
  const std::lock_guard lock(mutex_);
  --aside_;
  ++running_;
  running_builds_ += lane == Lane::kBuild ? 1 : 0;
}

void WorkQueue::Stop() {
  std::list<Job> dropped;  // destroyed after the lock
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
    dropped.swap(jobs_);
    changed_.notify_all();
  }
  for (std::thread& thread : threads_) {
    if (thread.joinable()) thread.join();
  }
}

std::list<WorkQueue::Job>::iterator WorkQueue::NextRunnable() noexcept {
  if (running_ >= max_running_) return jobs_.end();
  ++looks_;
  auto build = jobs_.end();
  for (auto job = jobs_.begin(); job != jobs_.end(); ++job) {
    Line& line = job->line->second;
    const bool is_first = !line.is_busy && line.looked_at != looks_;
    line.looked_at = looks_;
    if (!is_first) continue;
    if (job->lane == Lane::kLoad) return job;
    if (build == jobs_.end() && running_builds_ < max_builds_) build = job;
  }
  return build;
}

void WorkQueue::Work() {
  std::unique_lock lock(mutex_);
  for (;;) {
    auto next = jobs_.end();
    changed_.wait(lock, [&] { return stopping_ || (next = NextRunnable()) != jobs_.end(); });
    if (stopping_) return;
    Job job = std::move(*next);
    jobs_.erase(next);
    const bool is_build = job.lane == Lane::kBuild;
    job.line->second.is_busy = true;
    ++running_;
    running_builds_ += is_build ? 1 : 0;

    lock.unlock();
    try {
      job.run();
    } catch (...) {  // a job's exception must not end the process
    }
    job.run = nullptr;  // destroys its captures now, outside the lock
    lock.lock();

    --running_;
    running_builds_ -= is_build ? 1 : 0;
    job.line->second.is_busy = false;
    if (--job.line->second.jobs == 0) lines_.erase(job.line);
    changed_.notify_all();
  }
}

}  // namespace kdray::core
