#include "core/scene/tree.h"

#include <algorithm>
#include <thread>
#include <type_traits>
#include <utility>

#include "core/box/box_list_builder.h"
#include "core/bvh/bvh_builder.h"
#include "core/kdtree/kd_tree_builder.h"
#include "core/kdtree/kd_tree_stats.h"
#include "core/kdtree/sweep_split.h"
#include "core/tree/reference.h"
#include "core/tree/sah_cost.h"

namespace kdray::core {

namespace {

template <class Structure>
Result<Tree> WithStats(BuildKind kind, Result<Structure> structure, const SahCost& cost) {
  if (!structure.ok()) return std::move(structure).error();
  // Nothing here wants the nodes' bounds, and they are most of a kd-tree's memory.
  if constexpr (std::is_same_v<Structure, KdTree>) structure->node_bounds = {};
  Tree tree{kind, std::move(*structure), {}};
  tree.stats = ComputeStats(std::get<Structure>(tree.structure), cost);
  return tree;
}

}  // namespace

Result<Tree> BuildTree(const TriangleMesh& mesh, BuildKind kind, const BuildOptions& options) {
  const SahCost cost = SahCost::For(mesh.triangle_count());
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

// Upper bounds, derived from the limits of the builders rather than measured: a usual mesh needs a
// third of it or less. A vector that grows counts three times, old and new storage being there
// together.
std::uint64_t EstimateBuildBytes(std::size_t triangle_count, BuildKind kind) {
  const std::uint64_t n = triangle_count;
  const std::uint64_t threads = std::max(1u, std::thread::hardware_concurrency());
  // Triangles in the subtrees that single threads are at work on.
  const std::uint64_t serial = std::min(n, threads * KdBuildLimits::kTopReferences);
  constexpr std::uint64_t kFixed = 1 << 16;
  switch (kind) {
    case BuildKind::kBox:
      // The only leaf holds everything, so the histogram of leaves has n + 1 places.
      return kFixed + n * (sizeof(PrimitiveId) + sizeof(std::uint64_t));
    case BuildKind::kBvh:
      // References, ids, and the nodes (two for each triangle) as pieces and as one.
      return kFixed + n * (sizeof(Reference) + sizeof(PrimitiveId) + 4 * sizeof(BvhNode)) +
             serial * (3 * 2 * sizeof(BvhNode));
    default:
      break;
  }

  constexpr std::uint64_t kWeight = KdBuildLimits::kWeightPerTriangle;
  // A unit of weight in a finished subtree: at worst leaves as small as their weight allows, and
  // their parents.
  constexpr std::uint64_t kFinished =
      2 * (sizeof(KdNode) + sizeof(Bounds3f)) / KdBuildLimits::kLeafWeight + sizeof(PrimitiveId);
  // In a large node at most 3/8 of the weight are references; they are there twice while they are
  // handed to the children. kd-cyclic sorts four lists of floats.
  constexpr std::uint64_t kLarge = kWeight * 3 / 8 * (2 * sizeof(Reference) + 4 * sizeof(float));
  // KdSubtreeBuilder: its stack, with the children's references on top, and the piece it makes.
  constexpr std::uint64_t kSubtree =
      3 * (kWeight * (sizeof(Reference) + kFinished) + 2 * sizeof(Reference));
  // SweepBuilder: slots, sides and six events; events of one node kept, and made anew.
  constexpr std::uint64_t kSweep =
      3 * (kWeight * (sizeof(Reference) + 1 + 6 * sizeof(SplitEvent)) + 16 * sizeof(SplitEvent));
  const std::uint64_t scratch =
      serial * kSubtree + std::min(n, threads * KdBuildLimits::kSweepReferences) * kSweep;
  const std::uint64_t splitting = n * std::max(kLarge, kWeight * kFinished) + scratch;
  // Then the scratch is gone and the pieces are put together.
  const std::uint64_t assembling = n * 2 * kWeight * kFinished;
  return kFixed + std::max(splitting, assembling);
}

}  // namespace kdray::core
