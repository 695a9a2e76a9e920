// SPDX-License-Identifier: Apache-2.0
// Builds one subtree of a kd-tree on one thread.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "core/accel/kdtree/binned_split.h"
#include "core/accel/kdtree/centroid_split.h"
#include "core/accel/kdtree/kd_build_task.h"
#include "core/accel/kdtree/kd_piece.h"
#include "core/accel/kdtree/partition.h"
#include "core/accel/kdtree/sweep_builder.h"

namespace kdray::core {

/// Keeps scratch memory between subtrees: at most the budget of the largest, in references. For one
/// thread at a time.
class KdSubtreeBuilder {
 public:
  explicit KdSubtreeBuilder(const KdBuildContext& context)
      : context_(context),
        sweep_(context),
        note_(context.mesh, context.cost, context.monitor.cancel()) {}

  KdPiece Build(std::span<const PrimitiveRef> references, const KdBuildTask& task);

  /// Facts about a node's references; they stay true when empty space is cut off the cell.
  struct NodeFacts {
    Bounds3f bounds;                     ///< the union of theirs
    std::optional<BinnedCounts> counts;  ///< made when it is first needed
  };

  /// The rule's split of a node with these references; nullopt if it should be a leaf. The caller
  /// checks the budget.
  std::optional<SplitCandidate> FindSplit(std::span<const PrimitiveRef> references,
                                          const KdBuildTask& task, NodeFacts* facts);

 private:
  // The node's references are the uppermost `count` on the stack, which are removed.
  void BuildNode(std::size_t count, const KdBuildTask& task);
  void BuildNode(std::size_t count, const KdBuildTask& task, NodeFacts* facts);
  void EmitLeaf(std::span<const PrimitiveRef> references, const Bounds3f& bounds,
                const KdBuildTask& task);

  const KdBuildContext& context_;
  SweepBuilder sweep_;
  CentroidSplitFinder note_;
  std::vector<PrimitiveRef> stack_;  // never shrinks; stack_size_ entries are in use
  std::size_t stack_size_ = 0;
  std::vector<PrimitiveRef> below_, cut_;  // used only while a node is split
  KdPiece piece_;
};

}  // namespace kdray::core
