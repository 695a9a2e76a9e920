// SPDX-License-Identifier: Apache-2.0
#include "core/library/measurements.h"

#include <algorithm>
#include <utility>

namespace kdray::core {
namespace {

using SteadyClock = std::chrono::steady_clock;

// Poll interval of waiters; CancelToken has no notification.
constexpr std::chrono::milliseconds kLookAgain{50};

}  // namespace

std::shared_ptr<Measurements::Task> Measurements::Begin(const Sha256Digest& mesh) {
  auto task = std::make_shared<Task>();
  task->mesh = mesh;
  const std::lock_guard lock(mutex_);
  if (stopped_) return nullptr;
  const auto [entry, is_new] = entries_.try_emplace(mesh, Entry{task, std::nullopt});
  if (is_new) return task;
  if (entry->second.task) return nullptr;
  entry->second = {task, std::nullopt};
  return task;
}

bool Measurements::IsWanted(const Task& task) {
  const std::lock_guard lock(mutex_);
  return !task.done_;
}

void Measurements::End(const std::shared_ptr<Task>& task,
                       Result<MeasuredTradeoff> measured) noexcept {
  const std::lock_guard lock(mutex_);
  if (task->done_) return;
  const auto entry = entries_.find(task->mesh);
  entry->second = {nullptr, std::move(measured)};
  Land(task.get());
}

Result<std::optional<Measurements::Info>> Measurements::Wait(const Sha256Digest& mesh,
                                                             SteadyClock::time_point until,
                                                             const CancelToken& cancel) {
  std::unique_lock lock(mutex_);
  const auto entry = entries_.find(mesh);
  if (entry == entries_.end()) return std::optional<Info>();
  if (const std::shared_ptr<Task> task = entry->second.task) {
    while (!task->done_ && SteadyClock::now() < until && !cancel.ShouldStop()) {
      landed_.wait_until(lock, std::min(until, SteadyClock::now() + kLookAgain));
    }
    if (!task->done_) return std::optional(Info{std::nullopt, task->progress.fraction()});
  }
  const auto ended = entries_.find(mesh);  // it may have been forgotten, or restarted
  if (ended == entries_.end()) return std::optional<Info>();
  if (ended->second.task) {
    return std::optional(Info{std::nullopt, ended->second.task->progress.fraction()});
  }
  if (!ended->second.ended->ok()) return ended->second.ended->error();
  return std::optional(Info{**ended->second.ended, 1});
}

void Measurements::Adopt(const Sha256Digest& mesh, MeasuredTradeoff measured) {
  const std::lock_guard lock(mutex_);
  entries_.try_emplace(mesh, Entry{nullptr, std::move(measured)});
}

bool Measurements::Forget(const Sha256Digest& mesh) noexcept {
  const std::lock_guard lock(mutex_);
  const auto entry = entries_.find(mesh);
  if (entry == entries_.end()) return false;
  if (entry->second.task) {
    entry->second.task->cancel.Cancel();
    Land(entry->second.task.get());
  }
  entries_.erase(entry);
  return true;
}

void Measurements::Stop() {
  const std::lock_guard lock(mutex_);
  stopped_ = true;
  for (auto& [mesh, entry] : entries_) {
    if (!entry.task) continue;
    entry.task->cancel.Cancel();
    Land(entry.task.get());
    entry = {nullptr, Error{ErrorCode::kCancelled, "shutting down"}};
  }
}

void Measurements::Land(Task* task) {
  task->done_ = true;
  landed_.notify_all();
}

}  // namespace kdray::core
