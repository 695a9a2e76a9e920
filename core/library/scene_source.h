// Where scenes come from: memory, else the stored files, else the mesh's own bytes.
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

/// Safe from many threads at once, but for two calls about one mesh (WorkQueue keeps them apart).
class SceneSource {
 public:
  /// All outlive this. Builds run in `arena`.
  SceneSource(SceneStore* store, TreeCache* cache, MemoryBudget* budget, Arena* arena)
      : store_(store), cache_(cache), budget_(budget), arena_(arena) {}

  /// What the one who waits sees of the work. Written by the worker, read by anyone.
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
    bool was_parsed = false;  ///< not read from a stored file: worth storing
    bool was_built = false;
  };

  struct Hooks {
    /// Told the facts as soon as the mesh is there.
    std::function<void(const MeshFacts&)> on_mesh;
    /// Asked before the work waits for memory: another may have its thread's place meanwhile.
    std::function<std::optional<WorkQueue::Aside>()> step_aside;
  };
  /// The scene of `record`, in memory. Waits for memory when others hold it, by the rule of
  /// MemoryBudget, and holds none meanwhile. Errors: those of PrepareMesh and BuildTree;
  /// kMeshTooLarge when the memory limit could never hold it; kCorrupt, kNotFound, kIo when the
  /// mesh file itself cannot be read; kMemoryFull when it waited in vain, or as many wait already
  /// as may, or the system refuses memory.
  Result<Fetched> Fetch(const TreeRecord& record, Watch* watch, const Hooks& hooks);

  /// Puts what Fetch made on disk, as far as there is room.
  void Store(const TreeId& id, const Fetched& fetched);

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
