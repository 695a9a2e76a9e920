// A built structure of any kind, with its statistics.
#pragma once

#include <cstddef>
#include <cstdint>
#include <variant>

#include "core/base/result.h"
#include "core/box/box_list.h"
#include "core/bvh/bvh.h"
#include "core/geometry/triangle_mesh.h"
#include "core/kdtree/kd_tree.h"
#include "core/tree/build_kind.h"
#include "core/tree/build_options.h"
#include "core/tree/tree_stats.h"

namespace kdray::core {

/// Immutable once built; safe from many threads at once.
struct Tree {
  BuildKind build = BuildKind::kBox;
  std::variant<BoxList, Bvh, KdTree> structure;
  TreeStats stats;

  std::uint64_t bytes() const {
    return std::visit([](const auto& s) { return s.bytes(); }, structure);
  }
};

/// Builds `kind` over the mesh's non-degenerate triangles, in parallel within the caller's arena.
/// The result is the same for every number of threads. Ends on any mesh: depth at most
/// KdTree::kMaxDepth, at most 8 references a triangle. Errors: kCancelled, kDeadlineExceeded.
Result<Tree> BuildTree(const TriangleMesh& mesh, BuildKind kind, const BuildOptions& options = {});

/// Upper bound of the memory that BuildTree holds at its peak, the tree included, without the mesh.
std::uint64_t EstimateBuildBytes(std::size_t triangle_count, BuildKind kind);

}  // namespace kdray::core
