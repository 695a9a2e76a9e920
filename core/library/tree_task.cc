// SPDX-License-Identifier: Apache-2.0
#include "core/library/tree_task.h"

#include <algorithm>

namespace kdray::core {
namespace {

// Poll interval; a CancelToken has no notification.
constexpr std::chrono::milliseconds kLookAgain{50};

}  // namespace

bool TreeTask::Wait(std::chrono::steady_clock::time_point until, const CancelToken& cancel) const {
  std::unique_lock lock(mutex_);
  while (!has_ended_) {
    const auto now = std::chrono::steady_clock::now();
    if (now >= until || cancel.ShouldStop()) return false;
    ended_.wait_until(lock, std::min(until, now + kLookAgain));
  }
  return true;
}

void TreeTask::End(std::optional<Scene> scene, std::optional<Error> error) noexcept {
  const std::lock_guard lock(mutex_);
  scene_ = std::move(scene);
  error_ = std::move(error);
  has_ended_ = true;
  ended_.notify_all();
}

}  // namespace kdray::core
