// Builds a KdTree. The upper part, whose nodes are large, is built here in parallel; the subtrees
// below come from KdSubtreeBuilder (kd_subtree_builder.h), one after the other in each thread.
#pragma once

#include <cstddef>
#include <cstdint>

#include "core/accel/build_options.h"
#include "core/accel/kdtree/kd_tree.h"
#include "core/accel/sah_cost.h"
#include "core/base/result.h"
#include "core/geometry/triangle_mesh.h"

namespace kdray::core {

/// Where nodes are cut and when they are not.
enum class KdSplitRule : std::uint8_t {
  kSah,     ///< exact SAH candidates in small nodes, binned ones above
  kBinned,  ///< binned SAH candidates everywhere
  kCyclic,  ///< the lecture note's Algorithm 1
  kMedian,  ///< the lecture note's naive build
};

struct KdBuildLimits {
  /// The deepest leaf allowed: 8 + 1.6 log2(triangles), at most KdTree::kMaxDepth. Source: Havran
  /// 2000 for the form; the constants are measured (DESIGN.md).
  static int MaxDepth(std::size_t triangles);
  /// References over all leaves for each triangle of the mesh; a leaf with fewer references than
  /// kLeafWeight counts as that many, so that nodes are bounded too.
  static constexpr std::uint64_t kWeightPerTriangle = 8;
  static constexpr std::uint64_t kLeafWeight = 4;
  /// A node with no more references is built by one thread. Part of the result, like the others:
  /// the budget's rule is stricter above (WeightBudget::AllowsAtTop).
  static constexpr std::size_t kTopReferences = 8192;
  /// From here on kd-sah tries every plane that can be best; larger nodes have so many triangles
  /// that bins do as well (DESIGN.md has the figures).
  static constexpr std::size_t kSweepReferences = 256;
  /// A kd-median node with so many triangles is a leaf.
  static constexpr std::size_t kMedianLeaf = 8;
};

/// The tree over the mesh's non-degenerate triangles; a mesh without any gets one empty leaf. For
/// every point of every triangle, some leaf whose closed cell holds the point refers to the
/// triangle: what KdTree::Traverse relies on. In parallel within the caller's arena, with the same
/// result for every number of threads. Ends on any mesh, within the limits above. Errors:
/// kCancelled, kDeadlineExceeded. kSah and kBinned: O(n log n) time; kCyclic: O(n log^2 n).
Result<KdTree> BuildKdTree(const TriangleMesh& mesh, KdSplitRule rule, const SahCost& cost,
                           const BuildOptions& options);

}  // namespace kdray::core
