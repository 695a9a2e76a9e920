// SPDX-License-Identifier: Apache-2.0
// Builds a KdTree. The upper part, whose nodes are large, is built here in parallel;
// KdSubtreeBuilder (kd_subtree_builder.h) builds the subtrees below, each on one thread.
#pragma once

#include <cstddef>
#include <cstdint>

#include "core/accel/build_options.h"
#include "core/accel/kdtree/kd_tree.h"
#include "core/accel/sah_cost.h"
#include "core/base/result.h"
#include "core/geometry/triangle_mesh.h"

namespace kdray::core {

/// The rule that decides whether and where a node is split.
enum class KdSplitRule : std::uint8_t {
  kSah,     ///< exact SAH candidates in small nodes, bins in larger ones
  kBinned,  ///< binned SAH candidates everywhere
  kCyclic,  ///< Algorithm 1 of Tang 2019
  kMedian,  ///< the naive build of Tang 2019
};

struct KdBuildLimits {
  /// The deepest leaf allowed: 8 + 1.6 log2(triangles), at most KdTree::kMaxDepth. Source: Havran
  /// 2000 for the form; the constants are measured.
  static int MaxDepth(std::size_t triangles);
  /// Limit of the references in all leaves, per triangle of the mesh. A leaf counts as at least
  /// kLeafWeight references, so the number of nodes is bounded too.
  static constexpr std::uint64_t kWeightPerTriangle = 8;
  static constexpr std::uint64_t kLeafWeight = 4;
  /// A node with at most this many references is built by one thread. It affects the tree, because
  /// the budget's rule is stricter for larger nodes (WeightBudget::AllowsAtTop).
  static constexpr std::size_t kTopReferences = 8192;
  /// In nodes with at most this many references, kd-sah tries every plane that can be best; in
  /// larger nodes bins are as good (docs/experiments/kd_builders.md).
  static constexpr std::size_t kSweepReferences = 256;
  /// A kd-median node with at most this many triangles is a leaf.
  static constexpr std::size_t kMedianLeaf = 8;
};

/// The tree over the mesh's non-degenerate triangles; a mesh without any gets one empty leaf. For
/// every point of every triangle, a leaf whose closed cell contains the point refers to the
/// triangle; KdTree::Traverse depends on that. In parallel within the caller's arena, with the same
/// result for every number of threads. Ends on any mesh, within the limits above. Errors:
/// kCancelled, kDeadlineExceeded. kSah and kBinned: O(n log n) time; kCyclic: O(n log^2 n).
Result<KdTree> BuildKdTree(const TriangleMesh& mesh, KdSplitRule rule, const SahCost& cost,
                           const BuildOptions& options);

}  // namespace kdray::core
