// SPDX-License-Identifier: Apache-2.0
// A built tree of any kind, with its statistics.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <variant>

#include "core/accel/box/box_list.h"
#include "core/accel/build_kind.h"
#include "core/accel/build_options.h"
#include "core/accel/bvh/bvh.h"
#include "core/accel/kdtree/kd_tree.h"
#include "core/accel/tree_stats.h"
#include "core/accel/wide/wide_tree.h"
#include "core/base/result.h"
#include "core/geometry/triangle_mesh.h"

namespace kdray::core {

/// A structure as its builder makes it: the source of cells, statistics and step counts.
using BinaryTree = std::variant<BoxList, Bvh, KdTree>;

/// A built structure in the form that queries use (wide_tree.h), and the statistics of its binary
/// tree. Immutable once built; safe from many threads at once.
class Tree {
 public:
  BuildKind build = BuildKind::kBox;
  WideTree wide;
  TreeStats stats;  ///< of the binary tree, except `bytes`, which are those of the wide tree

  std::uint64_t bytes() const { return wide.bytes(); }
  /// Upper bound of its memory: Binary() rebuilds the binary tree and keeps it.
  std::uint64_t most_bytes() const {
    return bytes() + stats.nodes * sizeof(BvhNode) + stats.references * sizeof(PrimitiveId);
  }

  /// The binary tree over the same mesh. Rebuilt on demand: queries do not need it, and it takes no
  /// longer than the first build. Errors: those of BuildTree.
  Result<std::shared_ptr<const BinaryTree>> Binary(const TriangleMesh& mesh,
                                                   const BuildOptions& options = {}) const;
  /// The binary tree that Binary made before; null when nobody has asked for it.
  std::shared_ptr<const BinaryTree> kept_binary() const;

 private:
  struct Kept;
  mutable std::shared_ptr<Kept> kept_ = MakeKept();
  static std::shared_ptr<Kept> MakeKept();
};

/// Builds `kind` over the mesh's non-degenerate triangles, in parallel within the caller's arena.
/// The result is the same for every number of threads. Ends on any mesh: depth at most
/// KdTree::kMaxDepth, at most 8 references a triangle. Errors: kCancelled, kDeadlineExceeded.
Result<Tree> BuildTree(const TriangleMesh& mesh, BuildKind kind, const BuildOptions& options = {});

/// Only the binary tree, as BuildTree makes it.
Result<BinaryTree> BuildBinaryTree(const TriangleMesh& mesh, BuildKind kind,
                                   const BuildOptions& options = {});

/// The second half of BuildTree; `binary` is the result of BuildBinaryTree. Errors: kCancelled,
/// kDeadlineExceeded.
Result<Tree> FinishTree(const TriangleMesh& mesh, BuildKind kind, const BinaryTree& binary,
                        const CancelToken& cancel = {});

/// Memory of a build, in two steps, without the mesh. The first is an upper bound for
/// BuildBinaryTree, and for usual meshes for all of BuildTree. The second is an upper bound for
/// FinishTree, both trees included; it detects an unusual mesh before FinishTree allocates.
std::uint64_t EstimateBuildBytes(std::size_t triangle_count, BuildKind kind);
std::uint64_t EstimateFinishBytes(const BinaryTree& binary);

}  // namespace kdray::core
