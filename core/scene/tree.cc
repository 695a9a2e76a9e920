#include "core/scene/tree.h"

#include <utility>

#include "core/box/box_list_builder.h"
#include "core/bvh/bvh_builder.h"
#include "core/kdtree/kd_tree_builder.h"
#include "core/kdtree/kd_tree_stats.h"
#include "core/tree/build_monitor.h"
#include "core/tree/sah_cost.h"

namespace kdray::core {

namespace {

template <class Structure>
Result<Tree> WithStats(BuildKind kind, Result<Structure> structure, const SahCost& cost) {
  if (!structure.ok()) return std::move(structure).error();
  Tree tree{kind, std::move(*structure), {}};
  tree.stats = ComputeStats(std::get<Structure>(tree.structure), cost);
  return tree;
}

}  // namespace

Result<Tree> BuildTree(const TriangleMesh& mesh, BuildKind kind, const BuildOptions& options) {
  const SahCost cost;
  const auto kd_tree = [&](KdSplitRule rule) {
    return WithStats(kind, BuildKdTree(mesh, rule, cost, options), cost);
  };
  switch (kind) {
    case BuildKind::kKdSah:
      return kd_tree(KdSplitRule::kSah);
    case BuildKind::kKdBinned:
      return kd_tree(KdSplitRule::kBinned);
    case BuildKind::kKdCyclic:
      return kd_tree(KdSplitRule::kCyclic);
    case BuildKind::kKdMedian:
      return kd_tree(KdSplitRule::kMedian);
    case BuildKind::kBvh:
      return WithStats(kind, BuildBvh(mesh, cost, options), cost);
    case BuildKind::kBox:
      return WithStats(kind, BuildBoxList(mesh, options), cost);
  }
  return Error{ErrorCode::kInvalidArgument, "no such build"};
}

std::uint64_t EstimateBuildBytes(std::size_t triangle_count, BuildKind kind) {
  const std::uint64_t n = triangle_count;
  switch (kind) {
    case BuildKind::kBox:
      return n * sizeof(PrimitiveId);
    case BuildKind::kBvh:
      return n * 200;
    default:
      return n * 400;
  }
}

}  // namespace kdray::core
