// SPDX-License-Identifier: Apache-2.0
#include "core/accel/kdtree/kd_tree_builder.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>
#include <vector>

#include "core/accel/build_monitor.h"
#include "core/accel/kdtree/kd_build_task.h"
#include "core/accel/kdtree/kd_piece.h"
#include "core/accel/kdtree/kd_subtree_builder.h"
#include "core/accel/kdtree/partition.h"
#include "core/base/parallel.h"

namespace kdray::core {

namespace {

class KdTreeBuilder {
 public:
  KdTreeBuilder(const TriangleMesh& mesh, KdSplitRule rule, const SahCost& cost,
                const BuildOptions& options)
      : monitor_(options), context_{mesh, rule, cost, 0, monitor_} {}

  Result<KdTree> Build() {
    PrimitiveRefArray references = MakePrimitiveRefs(context_.mesh, &monitor_);
    const std::size_t triangles = references.size();
    context_.max_depth = KdBuildLimits::MaxDepth(triangles);

    KdTree tree;
    const Bounds3f bounds = UnionBounds(references, &monitor_);
    // Then some references may be uninitialised.
    if (monitor_.ShouldStop()) return monitor_.Finish().error();
    tree.bounds = bounds;
    // Node positions have 30 bits.
    const std::uint64_t weight = std::min<std::uint64_t>(
        KdBuildLimits::kWeightPerTriangle * triangles, KdNode::kMaxIndex / 2);
    KdUpperNode root;
    BuildTop({std::move(references), bounds}, {bounds, 0, WeightBudget(weight), 1.0}, &root);

    if (!monitor_.ShouldStop()) Assemble(&root, &monitor_, &tree);
    const Status status = monitor_.Finish();
    if (!status.ok()) return status.error();
    return tree;
  }

 private:
  void BuildTop(Share share, const KdBuildTask& task, KdUpperNode* node) {
    if (share.references.size() <= KdBuildLimits::kTopReferences) {
      node->piece = KdSubtreeBuilder(context_).Build(share.references, task);
      return;
    }
    KdSubtreeBuilder::NodeFacts facts{share.bounds, {}};
    BuildTop(std::move(share.references), task, &facts, node);
  }

  void BuildTop(PrimitiveRefArray references, const KdBuildTask& task,
                KdSubtreeBuilder::NodeFacts* facts, KdUpperNode* node) {
    std::optional<SplitCandidate> split;
    if (!monitor_.ShouldStop()) {
      split = KdSubtreeBuilder(context_).FindSplit(references, task, facts);
    }
    if (monitor_.ShouldStop()) return;
    if (!split || !task.budget.AllowsAtTop(split->below, split->above)) {
      CancelPoll poll = monitor_.MakePoll();
      PolledLoop(references.size(), 4, &poll,
                 [&](std::size_t i) { node->piece.primitives.push_back(references.data()[i].id); });
      if (poll.stopped()) return;
      node->piece.EndLeaf(references.size(), facts->bounds);
      monitor_.AddDone(task.share);
      return;
    }
    if (split->below == 0 || split->above == 0) {
      CutOffEmptySpace(std::move(references), task, facts, *split, node);
      return;
    }
    Share below, above;
    DistributeInParallel(context_.mesh, references, task.cell, *split, &below, &above, &monitor_);
    if (monitor_.ShouldStop()) return;
    references = {};

    const auto [below_task, above_task] =
        task.Divide(split->plane, below.references.size(), above.references.size());
    node->plane = split->plane;
    node->below = std::make_unique<KdUpperNode>();
    node->above = std::make_unique<KdUpperNode>();
    ParallelInvoke([&, t = below_task] { BuildTop(std::move(below), t, node->below.get()); },
                   [&, t = above_task] { BuildTop(std::move(above), t, node->above.get()); });
  }

  void CutOffEmptySpace(PrimitiveRefArray references, const KdBuildTask& task,
                        KdSubtreeBuilder::NodeFacts* facts, const SplitCandidate& split,
                        KdUpperNode* node) {
    const auto [below, above] = task.Divide(split.plane, split.below, split.above);
    node->plane = split.plane;
    node->below = std::make_unique<KdUpperNode>();
    node->above = std::make_unique<KdUpperNode>();
    const bool is_below = split.above == 0;
    KdUpperNode* const empty = is_below ? node->above.get() : node->below.get();
    empty->piece.EndLeaf(0, Bounds3f::Empty());
    monitor_.AddDone(is_below ? above.share : below.share);
    BuildTop(std::move(references), is_below ? below : above, facts,
             is_below ? node->below.get() : node->above.get());
  }

  BuildMonitor monitor_;
  KdBuildContext context_;
};

}  // namespace

int KdBuildLimits::MaxDepth(std::size_t triangles) {
  const double log = std::log2(static_cast<double>(std::max<std::size_t>(triangles, 1)));
  return std::min(KdTree::kMaxDepth, static_cast<int>(8 + 1.6 * log));
}

Result<KdTree> BuildKdTree(const TriangleMesh& mesh, KdSplitRule rule, const SahCost& cost,
                           const BuildOptions& options) {
  return KdTreeBuilder(mesh, rule, cost, options).Build();
}

}  // namespace kdray::core
