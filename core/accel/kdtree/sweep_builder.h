// SPDX-License-Identifier: Apache-2.0
// Builds a small subtree with the exact candidates of the surface area heuristic.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "core/accel/kdtree/event_sort.h"
#include "core/accel/kdtree/kd_build_task.h"
#include "core/accel/kdtree/kd_piece.h"
#include "core/accel/kdtree/partition.h"
#include "core/accel/kdtree/sweep_split.h"
#include "core/accel/primitive_ref.h"

namespace kdray::core {

/// The O(n log n) build: events are sorted once for the subtree's root and stay sorted on the way
/// down; only the events of references that a plane cuts are made anew. Keeps its scratch memory
/// between subtrees: for a subtree of weight w, 76 bytes * w. One thread at a time. Source: Wald
/// and Havran 2006, section 4.3.
class SweepBuilder {
 public:
  explicit SweepBuilder(const KdBuildContext& context)
      : context_(context), costs_(SubtreeCosts(context.cost, KdBuildLimits::kSweepReferences)) {}

  /// Appends the subtree to *piece; at most KdBuildLimits::kSweepReferences references.
  void Build(std::span<const PrimitiveRef> references, const KdBuildTask& task, KdPiece* piece);

 private:
  // How many events a node has on each axis.
  using Counts = std::array<std::size_t, 3>;
  using EventLists = std::array<std::vector<SplitEvent>, 3>;

  // The node at work owns the uppermost events; they are gone afterwards.
  void BuildNode(std::size_t triangles, const Counts& events, const KdBuildTask& task);
  std::span<const SplitEvent> TopEvents(int axis, const Counts& counts) const;
  void EmitLeaf(std::size_t triangles, const Counts& events, const KdBuildTask& task);
  SideCounts AssignSides(const Counts& events, const KdBuildTask& task,
                         const SplitCandidate& split);
  static void AppendFresh(const Bounds3f& bounds, std::uint32_t slot, EventLists* fresh);
  std::pair<Counts, Counts> DivideEvents(const Counts& events);

  const KdBuildContext& context_;
  const std::vector<double> costs_;
  KdPiece* piece_ = nullptr;

  // A reference keeps its slot on the way down. A cut one leaves it to its below part; the above
  // part gets a new one, which lives until the above child is done.
  std::vector<PrimitiveRef> slots_;

  // A stack of sorted lists for each axis: the node's, beneath it those of the above children that
  // wait.
  EventLists events_;
  EventSorter sorter_;

  // Only while a node is split.
  std::vector<unsigned char> sides_;      // by slot: bits of Side; 0 for those that the plane cuts
  EventLists fresh_below_, fresh_above_;  // of those
  std::vector<SplitEvent> kept_below_, kept_above_;
};

}  // namespace kdray::core
