// Gets scenes from memory, else from stored files, else from the mesh's bytes.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>

#include "core/base/cancel.h"
#include "core/base/parallel.h"
#include "core/base/progress.h"
#include "core/base/result.h"
#include "core/catalog/parsed_mesh.h"
#include "core/library/memory_budget.h"
#include "core/library/tree_cache.h"
#include "core/library/work_queue.h"
#include "core/scene/scene.h"
#include "core/store/catalog.h"
#include "core/store/scene_store.h"

namespace kdray::core {

/// Safe from many threads at once, except for two calls about one mesh, which WorkQueue serialises.
class SceneSource {
 public:
  /// All must outlive this. Builds run in `arena`.
  SceneSource(SceneStore* store, TreeCache* cache, MemoryBudget* budget, Arena* arena)
      : store_(store), cache_(cache), budget_(budget), arena_(arena) {}

  /// The progress of the work. Written by the worker, read by any thread.
  struct Watch {
    CancelToken cancel = CancelToken::Cancellable();
    Progress build_progress;
    std::atomic<bool> parsed{false};
    std::atomic<bool> waits_for_memory{false};

    /// 0..1; parsing counts a tenth.
    double fraction() const { return parsed ? 0.1 + 0.9 * build_progress.fraction() : 0.0; }
  };

  struct Fetched {
    Scene scene;
    TreeCache::MeshPointer prepared;
    TreeFacts tree;
    bool was_parsed = false;  ///< not read from a stored file, so worth storing
    bool was_built = false;
  };

  struct Hooks {
    /// Called with the facts when the mesh is ready.
    std::function<void(const MeshFacts&)> on_mesh;
    /// Called before the work waits for memory, to let another job use its place.
    std::function<std::optional<WorkQueue::Aside>()> step_aside;
  };
  /// The scene of `record`, in memory. Waits for memory by the rule of MemoryBudget, holding none
  /// meanwhile. Errors: those of PrepareMesh and BuildTree; kMeshTooLarge if the memory limit is
  /// too small for it; kCorrupt, kNotFound, kIo if the mesh file cannot be read; kMemoryFull after
  /// the longest wait, if too many wait already, or if the system has no memory.
  Result<Fetched> Fetch(const TreeRecord& record, Watch* watch, const Hooks& hooks);

  /// Stores the results of Fetch, if there is room, until `cancel` stops it.
  void Store(const TreeId& id, const Fetched& fetched, const CancelToken& cancel);

  std::uint64_t parses() const { return parses_; }
  std::uint64_t builds() const { return builds_; }
  std::uint64_t loads() const { return loads_; }

 private:
  class Attempt;
  Result<MemoryCharge> Reserve(std::uint64_t bytes, Watch* watch, const Hooks& hooks);

  SceneStore* store_;
  TreeCache* cache_;
  MemoryBudget* budget_;
  Arena* arena_;
  std::atomic<std::uint64_t> parses_{0};
  std::atomic<std::uint64_t> builds_{0};
  std::atomic<std::uint64_t> loads_{0};
};

}  // namespace kdray::core
