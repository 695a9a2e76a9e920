// SPDX-License-Identifier: Apache-2.0
// Where scenes come from: memory, else the stored files, else the mesh's own bytes.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>

#include "core/base/parallel.h"
#include "core/base/result.h"
#include "core/catalog/facts.h"
#include "core/catalog/records.h"
#include "core/library/loaded_scene.h"
#include "core/library/memory_budget.h"
#include "core/library/tree_cache.h"
#include "core/library/work_queue.h"
#include "core/store/scene_store.h"

namespace kdray::core {

/// Safe from many threads at once, except for two calls about one mesh, which WorkQueue serialises.
class SceneLoader {
 public:
  /// All must outlive this. Builds run in `arena`.
  SceneLoader(SceneStore* store, TreeCache* cache, MemoryBudget* budget, Arena* arena)
      : store_(store), cache_(cache), budget_(budget), arena_(arena) {}

  struct Hooks {
    /// Called with the facts when the mesh is ready.
    std::function<void(const MeshFacts&)> on_mesh;
    /// Called before the work waits for memory, to let another job use its place.
    std::function<std::optional<WorkQueue::Aside>()> step_aside;
  };
  /// The scene of `record`, in memory. Waits for memory by the rule of MemoryBudget, holding none
  /// meanwhile. Errors: those of ParseMesh and BuildTree; kMeshTooLarge if the memory limit is
  /// too small for it; kCorrupt, kNotFound, kIo if the mesh file cannot be read; kMemoryFull after
  /// the longest wait, if too many wait already, or if the system has no memory.
  Result<LoadedScene> Load(const TreeRecord& record, LoadWatch* watch, const Hooks& hooks);

  /// Stores the results of Load, if there is room, until `cancel` stops it.
  void Store(const TreeId& id, const LoadedScene& loaded, const CancelToken& cancel);

  std::uint64_t parses() const { return parses_; }
  std::uint64_t builds() const { return builds_; }
  std::uint64_t loads() const { return loads_; }

 private:
  class Attempt;
  Result<MemoryCharge> Reserve(std::uint64_t bytes, LoadWatch* watch, const Hooks& hooks);

  SceneStore* store_;
  TreeCache* cache_;
  MemoryBudget* budget_;
  Arena* arena_;
  std::atomic<std::uint64_t> parses_{0};
  std::atomic<std::uint64_t> builds_{0};
  std::atomic<std::uint64_t> loads_{0};
};

}  // namespace kdray::core
