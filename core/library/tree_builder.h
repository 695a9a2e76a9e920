// SPDX-License-Identifier: Apache-2.0
// Runs the tasks of TreeRegistry on background threads.
#pragma once

#include <chrono>
#include <memory>
#include <optional>

#include "core/base/result.h"
#include "core/library/loaded_scene.h"
#include "core/library/mesh_locks.h"
#include "core/library/scene_loader.h"
#include "core/library/shared_trees.h"
#include "core/library/tree_registry.h"
#include "core/library/tree_remover.h"
#include "core/library/tree_task.h"
#include "core/library/work_queue.h"
#include "core/store/scene_store.h"

namespace kdray::core {

/// Safe from many threads at once.
class TreeBuilder {
 public:
  /// All must outlive this.
  struct Parts {
    TreeRegistry* registry;
    TreeRemover* remover;
    SceneLoader* loader;
    SceneStore* store;
    MeshLocks* mesh_locks;
    WorkQueue* queue;
    SharedTrees* shared;  ///< null without a shared store
  };
  explicit TreeBuilder(const Parts& parts) : parts_(parts) {}

  /// Passes the task on to a thread of the queue (TreeRegistry::Start).
  void Start(const std::shared_ptr<TreeTask>& task);

 private:
  void Run(const std::shared_ptr<TreeTask>& task) noexcept;
  void Bring(const TreeTask& task, LoadWatch* watch);
  bool CountResume(const TreeTask& task, bool* is_counted);
  void UncountResume(const TreeId& id);
  Result<LoadedScene> Load(const TreeTask& task, const TreeRecord& record, LoadWatch* watch);
  void Store(const TreeRecord& before, const LoadedScene& loaded);
  void StoreHere(const TreeRecord& before, const LoadedScene& loaded);
  void Fail(const TreeTask& task, const Error& error);
  bool FailHere(const TreeTask& task, const Error& error);

  const Parts parts_;
};

}  // namespace kdray::core
