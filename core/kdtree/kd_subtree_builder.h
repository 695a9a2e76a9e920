// Builds one subtree of a kd-tree on one thread.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "core/geometry/triangle_mesh.h"
#include "core/kdtree/kd_build_task.h"
#include "core/kdtree/kd_piece.h"
#include "core/kdtree/kd_tree_builder.h"
#include "core/kdtree/note_split.h"
#include "core/kdtree/partition.h"
#include "core/tree/build_monitor.h"
#include "core/tree/sah_cost.h"

namespace kdray::core {

/// What all parts of one build share.
struct KdBuildContext {
  const TriangleMesh& mesh;
  KdSplitRule rule;
  const SahCost& cost;
  int max_depth;
  BuildMonitor& monitor;
};

/// Keeps scratch memory between subtrees: at most the budget of the largest, in references. One
/// thread at a time.
class KdSubtreeBuilder {
 public:
  explicit KdSubtreeBuilder(const KdBuildContext& context)
      : context_(context), note_(context.mesh, context.cost) {}

  KdPiece Build(std::span<const Reference> references, const KdBuildTask& task);

  /// Where the rule cuts a node with these references; nothing when it should be a leaf. The
  /// budget is the caller's to check.
  std::optional<SplitCandidate> FindSplit(std::span<const Reference> references,
                                          const KdBuildTask& task);

 private:
  // The node's references are the uppermost `count` on the stack; they are gone afterwards.
  void BuildNode(std::size_t count, const KdBuildTask& task);
  void EmitLeaf(std::span<const Reference> references, const KdBuildTask& task);
  Reference* Push(std::size_t count);

  const KdBuildContext& context_;
  NoteSplitFinder note_;
  std::vector<Reference> stack_;  // as large as it ever was; stack_size_ of it in use
  std::size_t stack_size_ = 0;
  KdPiece piece_;
};

}  // namespace kdray::core
