// Built structures of any kind, with their statistics.
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

/// A structure as its builder makes it: what the lecture note describes, what cells, statistics and
/// counted steps are taken from.
using BinaryTree = std::variant<BoxList, Bvh, KdTree>;

/// A built structure in the form that queries use (core/accel/wide/wide_tree.h), and what is known
/// about the binary tree it was made from. Immutable once built; safe from many threads at once.
class Tree {
 public:
  BuildKind build = BuildKind::kBox;
  WideTree wide;
  TreeStats stats;  ///< of the binary tree, but for `bytes`, which are those of the wide one

  std::uint64_t bytes() const { return wide.bytes(); }
  /// What it may come to: the binary tree is made again, and then kept, when somebody asks.
  std::uint64_t most_bytes() const {
    return bytes() + stats.nodes * sizeof(BvhNode) + stats.references * sizeof(PrimitiveId);
  }

  /// The binary tree over the same mesh. Made on demand: queries do not need it, and making it
  /// again takes no longer than the first time. Errors: those of BuildTree.
  Result<std::shared_ptr<const BinaryTree>> Binary(const TriangleMesh& mesh,
                                                   const BuildOptions& options = {}) const;

 private:
  struct Kept;
  mutable std::shared_ptr<Kept> kept_ = MakeKept();
  static std::shared_ptr<Kept> MakeKept();
};

/// Builds `kind` over the mesh's non-degenerate triangles, in parallel within the caller's arena.
/// The result is the same for every number of threads. Ends on any mesh: depth at most
/// KdTree::kMaxDepth, at most 8 references a triangle. Errors: kCancelled, kDeadlineExceeded.
Result<Tree> BuildTree(const TriangleMesh& mesh, BuildKind kind, const BuildOptions& options = {});

/// The binary tree alone: the same that BuildTree makes on its way.
Result<BinaryTree> BuildBinaryTree(const TriangleMesh& mesh, BuildKind kind,
                                   const BuildOptions& options = {});

/// The second half of BuildTree; `binary` is what BuildBinaryTree made. Errors: kCancelled,
/// kDeadlineExceeded.
Result<Tree> FinishTree(const TriangleMesh& mesh, BuildKind kind, const BinaryTree& binary,
                        const CancelToken& cancel = {});

/// Memory of a build, in two steps, without the mesh. The first is an upper bound of what
/// BuildBinaryTree holds at its peak, and for usual meshes of all that BuildTree does; the second,
/// of what is there while FinishTree makes the wide tree, both trees included: exact enough to find
/// out that a mesh is not usual before anything is allocated for it.
std::uint64_t EstimateBuildBytes(std::size_t triangle_count, BuildKind kind);
std::uint64_t EstimateFinishBytes(const BinaryTree& binary);

}  // namespace kdray::core
