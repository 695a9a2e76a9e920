// SPDX-License-Identifier: Apache-2.0
#include "core/accel/kdtree/sweep_builder.h"

#include <algorithm>
#include <cassert>
#include <optional>
#include <utility>

#include "core/accel/kdtree/partition.h"

namespace kdray::core {

namespace {

// Appends the union of two sorted lists.
void AppendMerged(std::span<const SplitEvent> a, std::span<const SplitEvent> b,
                  std::vector<SplitEvent>* out) {
  const std::size_t size = out->size();
  out->resize(size + a.size() + b.size());
  std::merge(a.begin(), a.end(), b.begin(), b.end(),
             out->begin() + static_cast<std::ptrdiff_t>(size));
}

void AppendEvents(float low, float high, std::uint32_t slot, std::vector<SplitEvent>* out) {
  SplitEvent events[2];
  out->insert(out->end(), events, events + MakeEvents(low, high, slot, events));
}

}  // namespace

void SweepBuilder::Build(std::span<const PrimitiveRef> references, const KdBuildTask& task,
                         KdPiece* piece) {
  piece_ = piece;
  slots_.assign(references.begin(), references.end());
  Counts counts;
  for (int axis = 0; axis < 3; ++axis) {
    std::vector<SplitEvent>& events = events_[static_cast<std::size_t>(axis)];
    sorter_.Sort(references, axis, &events);
    counts[static_cast<std::size_t>(axis)] = events.size();
  }
  BuildNode(references.size(), counts, task);
}

void SweepBuilder::BuildNode(std::size_t triangles, const Counts& events, const KdBuildTask& task) {
  std::optional<SplitCandidate> split;
  if (triangles > SahCost::kBlock && task.depth < context_.max_depth) {
    SplitSearch search(context_.cost, task.cell, triangles);
    for (int axis = 0; axis < 3; ++axis) {
      SweepAxis(TopEvents(axis, events), axis, triangles, costs_, &search);
    }
    split = search.best();
  }
  if (!split || !task.budget.Allows(split->below, split->above)) {
    EmitLeaf(triangles, events, task);
    for (std::size_t a = 0; a < 3; ++a) events_[a].resize(events_[a].size() - events[a]);
    return;
  }

  // The references do not change when empty space is cut off.
  if (split->below == 0 || split->above == 0) {
    const auto [below, above] = task.Divide(split->plane, split->below, split->above);
    const std::size_t interior = piece_->BeginInterior();
    if (split->below == 0) {
      EmitLeaf(0, {}, below);
    } else {
      BuildNode(triangles, events, below);
    }
    piece_->EndBelow(interior, split->plane);
    if (split->above == 0) {
      EmitLeaf(0, {}, above);
    } else {
      BuildNode(triangles, events, above);
    }
    piece_->EndInterior(interior);
    return;
  }

  const std::size_t slots_before = slots_.size();
  const SideCounts counts = AssignSides(events, task, *split);
  const auto [below_events, above_events] = DivideEvents(events);
  const auto [below, above] = task.Divide(split->plane, counts.below, counts.above);

  const std::size_t interior = piece_->BeginInterior();
  const std::size_t slots_of_above = slots_.size();
  BuildNode(counts.below, below_events, below);
  slots_.resize(slots_of_above);
  piece_->EndBelow(interior, split->plane);
  BuildNode(counts.above, above_events, above);
  slots_.resize(slots_before);
  piece_->EndInterior(interior);
}

std::span<const SplitEvent> SweepBuilder::TopEvents(int axis, const Counts& counts) const {
  const std::size_t a = static_cast<std::size_t>(axis);
  return std::span(events_[a]).last(counts[a]);
}

void SweepBuilder::EmitLeaf(std::size_t triangles, const Counts& events, const KdBuildTask& task) {
  Bounds3f bounds = Bounds3f::Empty();
  for (const SplitEvent& event : TopEvents(0, events)) {
    if (event.kind() == SplitEvent::Kind::kEnd) continue;
    const PrimitiveRef& reference = slots_[event.slot()];
    bounds.Extend(reference.bounds);
    piece_->primitives.push_back(reference.id);
  }
  piece_->EndLeaf(triangles, bounds);
  context_.monitor.AddDone(task.share);
}

// Determines the side of each reference's events, and makes new events for those that the plane
// cuts.
SideCounts SweepBuilder::AssignSides(const Counts& events, const KdBuildTask& task,
                                     const SplitCandidate& split) {
  for (std::size_t a = 0; a < 3; ++a) {
    fresh_below_[a].clear();
    fresh_above_[a].clear();
  }
  SideCounts counts;
  sides_.resize(slots_.size());
  for (const SplitEvent& event : TopEvents(0, events)) {
    if (event.kind() == SplitEvent::Kind::kEnd) continue;
    const std::uint32_t slot = event.slot();
    const Side side = SideOf(slots_[slot], split);
    if (side != Side::kBoth) {
      sides_[slot] = static_cast<unsigned char>(side);
      counts.below += side == Side::kBelow;
      counts.above += side == Side::kAbove;
      continue;
    }
    sides_[slot] = 0;
    const PrimitiveRef whole = slots_[slot];
    const ClippedHalves parts = CutReference(context_.mesh, whole, task.cell, split.plane);
    if (!parts.below.IsEmpty()) {
      ++counts.below;
      slots_[slot].bounds = parts.below;
      AppendFresh(parts.below, slot, &fresh_below_);
    }
    if (!parts.above.IsEmpty()) {
      ++counts.above;
      const std::uint32_t new_slot = static_cast<std::uint32_t>(slots_.size());
      slots_.push_back({parts.above, whole.id});
      AppendFresh(parts.above, new_slot, &fresh_above_);
    }
  }
  return counts;
}

void SweepBuilder::AppendFresh(const Bounds3f& bounds, std::uint32_t slot, EventLists* fresh) {
  for (int axis = 0; axis < 3; ++axis) {
    AppendEvents(bounds.min[axis], bounds.max[axis], slot,
                 &(*fresh)[static_cast<std::size_t>(axis)]);
  }
}

// Replaces the node's events by its children's, with the below child's on top.
std::pair<SweepBuilder::Counts, SweepBuilder::Counts> SweepBuilder::DivideEvents(
    const Counts& events) {
  Counts below_counts, above_counts;
  for (std::size_t a = 0; a < 3; ++a) {
    // Every event is written to both lists; only the list that keeps it grows, because a branch
    // would be unpredictable.
    kept_below_.resize(events[a] + 1);
    kept_above_.resize(events[a] + 1);
    std::size_t below = 0;
    std::size_t above = 0;
    for (const SplitEvent& event : TopEvents(static_cast<int>(a), events)) {
      const unsigned side = sides_[event.slot()];
      kept_below_[below] = event;
      kept_above_[above] = event;
      below += side & 1u;
      above += side >> 1;
    }
    std::vector<SplitEvent>& stack = events_[a];
    stack.resize(stack.size() - events[a]);
    std::sort(fresh_above_[a].begin(), fresh_above_[a].end());
    AppendMerged(std::span(kept_above_).first(above), fresh_above_[a], &stack);
    std::sort(fresh_below_[a].begin(), fresh_below_[a].end());
    AppendMerged(std::span(kept_below_).first(below), fresh_below_[a], &stack);
    below_counts[a] = below + fresh_below_[a].size();
    above_counts[a] = above + fresh_above_[a].size();
  }
  return {below_counts, above_counts};
}

}  // namespace kdray::core
