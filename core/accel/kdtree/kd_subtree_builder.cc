// SPDX-License-Identifier: Apache-2.0
#include "core/accel/kdtree/kd_subtree_builder.h"

#include <algorithm>

namespace kdray::core {

namespace {

// Smaller nodes do not check for cancellation.
constexpr std::size_t kPollReferences = 4096;

}  // namespace

KdPiece KdSubtreeBuilder::Build(std::span<const PrimitiveRef> references, const KdBuildTask& task) {
  piece_.Clear();
  stack_.assign(references.begin(), references.end());
  stack_size_ = references.size();
  BuildNode(references.size(), task);
  return {{piece_.nodes.begin(), piece_.nodes.end()},
          {piece_.node_bounds.begin(), piece_.node_bounds.end()},
          {piece_.primitives.begin(), piece_.primitives.end()}};
}

std::optional<SplitCandidate> KdSubtreeBuilder::FindSplit(std::span<const PrimitiveRef> references,
                                                          const KdBuildTask& task,
                                                          NodeFacts* facts) {
  if (task.depth >= context_.max_depth) return std::nullopt;
  switch (context_.rule) {
    case KdSplitRule::kSah:
    case KdSplitRule::kBinned:
      if (references.size() <= SahCost::kBlock) return std::nullopt;
      if (!facts->counts) facts->counts.emplace(references, facts->bounds, &context_.monitor);
      // Then chunks may be missing, and the counts are invalid.
      if (references.size() > kReferenceChunk && context_.monitor.ShouldStop()) return std::nullopt;
      return facts->counts->FindSplit(task.cell, context_.cost);
    case KdSplitRule::kCyclic:
      return note_.FindCyclic(references, task.cell, task.depth);
    case KdSplitRule::kMedian:
      if (references.size() <= KdBuildLimits::kMedianLeaf) return std::nullopt;
      return note_.FindMedian(references, task.cell, task.depth);
  }
  return std::nullopt;
}

void KdSubtreeBuilder::BuildNode(std::size_t count, const KdBuildTask& task) {
  const std::span<PrimitiveRef> references = std::span(stack_).subspan(stack_size_ - count, count);
  if (context_.rule == KdSplitRule::kSah && count <= KdBuildLimits::kSweepReferences) {
    sweep_.Build(references, task, &piece_);
    stack_size_ -= count;
    return;
  }
  NodeFacts facts{UnionBounds(references), {}};
  BuildNode(count, task, &facts);
}

void KdSubtreeBuilder::BuildNode(std::size_t count, const KdBuildTask& task, NodeFacts* facts) {
  const std::size_t begin = stack_size_ - count;
  const std::span<PrimitiveRef> references = std::span(stack_).subspan(begin, count);
  const bool stop = count >= kPollReferences && context_.monitor.ShouldStop();
  const std::optional<SplitCandidate> split =
      stop ? std::nullopt : FindSplit(references, task, facts);
  if (!split || !task.budget.Allows(split->below, split->above)) {
    EmitLeaf(references, facts->bounds, task);
    stack_size_ = begin;
    return;
  }

  if (split->below == 0 || split->above == 0) {
    const auto [below, above] = task.Divide(split->plane, split->below, split->above);
    const std::size_t interior = piece_.BeginInterior();
    if (split->below == 0) {
      EmitLeaf({}, Bounds3f::Empty(), below);
    } else {
      BuildNode(count, below, facts);
    }
    piece_.EndBelow(interior, split->plane);
    if (split->above == 0) {
      EmitLeaf({}, Bounds3f::Empty(), above);
    } else {
      BuildNode(count, above, facts);
    }
    piece_.EndInterior(interior);
    return;
  }

  // The below child comes first in memory, so its references go on top. The above child's stay
  // where their parent's were.
  if (below_.size() < count) {
    below_.resize(count);
    cut_.resize(count);
  }
  const SideCounts counts = Distribute(context_.mesh, references, task.cell, *split, below_.data(),
                                       references.data(), cut_.data());
  stack_size_ = begin + counts.above + counts.below;
  if (stack_.size() < stack_size_) stack_.resize(std::max(stack_size_, stack_.size() * 2));
  std::copy_n(below_.data(), counts.below, stack_.data() + begin + counts.above);

  const auto [below, above] = task.Divide(split->plane, counts.below, counts.above);
  const std::size_t interior = piece_.BeginInterior();
  BuildNode(counts.below, below);
  piece_.EndBelow(interior, split->plane);
  BuildNode(counts.above, above);
  piece_.EndInterior(interior);
}

void KdSubtreeBuilder::EmitLeaf(std::span<const PrimitiveRef> references, const Bounds3f& bounds,
                                const KdBuildTask& task) {
  for (const PrimitiveRef& reference : references) piece_.primitives.push_back(reference.id);
  piece_.EndLeaf(references.size(), bounds);
  context_.monitor.AddDone(task.share);
}

}  // namespace kdray::core
