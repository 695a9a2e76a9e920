// SPDX-License-Identifier: Apache-2.0
// Binary trees are dropped once their wide trees are made. Cells and counted steps need them, so
// they are made again on request: once for all that ask, in memory that is reserved.
#pragma once

#include <atomic>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>

#include "core/base/cancel.h"
#include "core/base/hash.h"
#include "core/base/parallel.h"
#include "core/base/result.h"
#include "core/library/memory_budget.h"
#include "core/library/work_queue.h"
#include "core/scene/scene.h"

namespace kdray::core {

/// Safe from many threads at once.
class BinaryRebuilder {
 public:
  /// Both outlive this. Builds run in `arena`.
  BinaryRebuilder(MemoryBudget* budget, Arena* arena);
  ~BinaryRebuilder();  ///< as Stop

  /// After success `scene.tree` keeps its binary tree (Tree::kept_binary). `mesh` is the digest of
  /// the scene's mesh; two trees of one mesh are made one after the other.
  ///
  /// All who ask for one tree at the same time share one rebuild, which belongs to none of them: it
  /// ends early only when all of them have left. It reserves the estimate of a build, and gives it
  /// back at its end; what the tree keeps was charged when the tree was loaded
  /// (Tree::most_bytes). A rebuild that needs more than the limit leaves beside its own mesh and
  /// tree reserves all the rest, so every tree that is in memory has cells. A request does not wait
  /// for memory here, because the caller holds a tree that others may wait for.
  ///
  /// Errors: kMemoryFull when the memory is not free now; kDeadlineExceeded and kCancelled by
  /// `cancel`, and kCancelled after Stop.
  Status Ensure(const Sha256Digest& mesh, const Scene& scene, const CancelToken& cancel);

  /// Stops what is under way and tells all who wait. Ensure makes nothing after it.
  void Stop();

  /// Binary trees that were made.
  std::uint64_t rebuilds() const { return rebuilds_; }

 private:
  struct Rebuild;
  // The scene of a rebuild holds the tree, so no other tree has its address.
  using Rebuilds = std::map<const Tree*, std::shared_ptr<Rebuild>>;

  void Run(const std::shared_ptr<Rebuild>& rebuild) noexcept;
  Status Make(const Rebuild& rebuild);
  // With mutex_ held:
  std::shared_ptr<Rebuild> Join(const Sha256Digest& mesh, const Scene& scene);
  void End(Rebuild* rebuild, Status status) noexcept;

  MemoryBudget* budget_;
  Arena* arena_;
  std::atomic<std::uint64_t> rebuilds_{0};
  std::mutex mutex_;
  Rebuilds under_way_;
  bool stopped_ = false;
  WorkQueue queue_;  // last: its threads use all of the above
};

}  // namespace kdray::core
