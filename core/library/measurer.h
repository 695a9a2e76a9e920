// SPDX-License-Identifier: Apache-2.0
// Measures speed and accuracy on meshes (core/tradeoff) in the background, one mesh at a time.
#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <optional>

#include "core/base/cancel.h"
#include "core/base/parallel.h"
#include "core/base/result.h"
#include "core/catalog/tree_id.h"
#include "core/library/measurements.h"
#include "core/library/memory_budget.h"
#include "core/library/mesh_locks.h"
#include "core/library/tree_registry.h"
#include "core/library/work_queue.h"
#include "core/scene/scene.h"
#include "core/store/scene_store.h"
#include "core/tradeoff/tradeoff.h"

namespace kdray::core {

/// Safe from many threads at once.
class Measurer {
 public:
  /// All must outlive this.
  struct Parts {
    TreeRegistry* registry;
    Measurements* measurements;
    SceneStore* store;
    MeshLocks* mesh_locks;
    WorkQueue* queue;
    MemoryBudget* budget;
    Arena* arena;
    std::function<Result<Scene>(const TreeId&, const CancelToken&)> load;
  };
  explicit Measurer(Parts parts) : parts_(std::move(parts)) {}

  // As in TreeLibrary:
  Status Measure(const TreeId& id, TradeoffOptions options);
  Result<std::optional<Measurements::Info>> Wait(const TreeId& id,
                                                 std::chrono::steady_clock::time_point until,
                                                 const CancelToken& cancel);
  Result<bool> Forget(const TreeId& id);

 private:
  void Run(const TreeId& id, const std::shared_ptr<Measurements::Task>& task,
           const TradeoffOptions& options) noexcept;
  Result<MeasuredTradeoff> MeasureNow(const TreeId& id, TradeoffOptions options,
                                      Measurements::Task* task);

  const Parts parts_;
};

}  // namespace kdray::core
