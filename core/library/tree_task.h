// SPDX-License-Identifier: Apache-2.0
// The work under way for one tree, shared by all who wait for it.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <optional>
#include <utility>

#include "core/base/cancel.h"
#include "core/base/result.h"
#include "core/catalog/tree_id.h"
#include "core/library/loaded_scene.h"
#include "core/library/memory_budget.h"
#include "core/scene/scene.h"

namespace kdray::core {

/// One task loads or builds a tree for all requests that wait for it. A request that leaves does
/// not stop it. If it fails or its tree is deleted, all waiting requests get the error.
/// TreeRegistry makes and ends it; TreeBuilder runs it. Safe from many threads at once.
class TreeTask {
 public:
  enum class Kind : std::uint8_t {
    kLoad,    ///< the tree was ready before
    kBuild,   ///< a request has asked for a tree that is due
    kResume,  ///< a build that an earlier process began; perhaps without a request
  };
  TreeTask(const TreeId& tree, Kind task_kind, MemoryCharge admission)
      : id(tree), kind(task_kind), admission_(std::move(admission)) {}

  const TreeId id;
  const Kind kind;
  LoadWatch watch;

  /// Waits until it has ended, or until `until` or `cancel` comes. Returns whether it has ended.
  bool Wait(std::chrono::steady_clock::time_point until, const CancelToken& cancel) const;

  /// Once it has ended: why there is no tree, else the tree in memory.
  const std::optional<Error>& error() const { return error_; }
  const std::optional<Scene>& scene() const { return scene_; }

 private:
  friend class TreeRegistry;
  void End(std::optional<Scene> scene, std::optional<Error> error) noexcept;

  // Guarded by the registry's mutex:
  MemoryCharge admission_;     // of a build; returned at the end
  bool is_asked_for_ = false;  // by a request, perhaps after it began

  mutable std::mutex mutex_;
  mutable std::condition_variable ended_;
  bool has_ended_ = false;
  // Written once, before has_ended_:
  std::optional<Error> error_;
  std::optional<Scene> scene_;
};

}  // namespace kdray::core
