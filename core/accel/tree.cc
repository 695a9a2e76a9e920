// SPDX-License-Identifier: Apache-2.0
#include "core/accel/tree.h"

#include <algorithm>
#include <mutex>
#include <thread>
#include <utility>

#include "core/accel/box/box_list_builder.h"
#include "core/accel/build_monitor.h"
#include "core/accel/bvh/bvh_builder.h"
#include "core/accel/kdtree/kd_tree_builder.h"
#include "core/accel/kdtree/kd_tree_stats.h"
#include "core/accel/kdtree/sweep_split.h"
#include "core/accel/primitive_ref.h"
#include "core/accel/sah_cost.h"
#include "core/accel/wide/collapse.h"
#include "core/base/parallel.h"

namespace kdray::core {

struct Tree::Kept {
  std::mutex mutex;
  std::shared_ptr<const BinaryTree> binary;
};

std::shared_ptr<Tree::Kept> Tree::MakeKept() { return std::make_shared<Kept>(); }

Result<std::shared_ptr<const BinaryTree>> Tree::Binary(const TriangleMesh& mesh,
                                                       const BuildOptions& options) const {
  if (std::shared_ptr<const BinaryTree> kept = kept_binary()) return kept;
  // Built without the lock: a thread that waits for the lock inside a parallel loop could be the
  // one that the build waits for. Two simultaneous builds make the same tree.
  Result<BinaryTree> made = BuildBinaryTree(mesh, build, options);
  if (!made.ok()) return std::move(made).error();
  if (auto* kd_tree = std::get_if<KdTree>(&*made)) kd_tree->node_bounds = {};
  auto binary = std::make_shared<const BinaryTree>(*std::move(made));
  const std::lock_guard lock(kept_->mutex);
  if (!kept_->binary) kept_->binary = std::move(binary);
  return kept_->binary;
}

std::shared_ptr<const BinaryTree> Tree::kept_binary() const {
  const std::lock_guard lock(kept_->mutex);
  return kept_->binary;
}

namespace {

template <class Structure>
Result<BinaryTree> ToBinary(Result<Structure> structure) {
  if (!structure.ok()) return std::move(structure).error();
  return BinaryTree(*std::move(structure));
}

}  // namespace

Result<BinaryTree> BuildBinaryTree(const TriangleMesh& mesh, BuildKind kind,
                                   const BuildOptions& options) {
  const SahCost cost = SahCost::For(mesh.triangle_count());
  const auto kd_tree = [&](KdSplitRule rule) {
    return ToBinary(BuildKdTree(mesh, rule, cost, options));
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
      return ToBinary(BuildBvh(mesh, cost, options));
    case BuildKind::kBox:
      return ToBinary(BuildBoxList(mesh, options));
  }
  return Error{ErrorCode::kInvalidArgument, "no such build"};
}

Result<Tree> BuildTree(const TriangleMesh& mesh, BuildKind kind, const BuildOptions& options) {
  const Result<BinaryTree> binary = BuildBinaryTree(mesh, kind, options);
  if (!binary.ok()) return binary.error();
  return FinishTree(mesh, kind, *binary, options.cancel);
}

Result<Tree> FinishTree(const TriangleMesh& mesh, BuildKind kind, const BinaryTree& binary,
                        const CancelToken& cancel) {
  const BuildOptions options{cancel};
  BuildMonitor monitor(options);
  const SahCost cost = SahCost::For(mesh.triangle_count());
  Tree tree;
  tree.build = kind;
  std::visit(
      [&](const auto& structure) {
        // The statistics are summed in the order of the nodes, so on one thread.
        ParallelInvoke([&] { tree.wide = Collapse(mesh, structure, &monitor); },
                       [&] { tree.stats = ComputeStats(structure, cost, cancel); });
      },
      binary);
  if (const Status status = monitor.Finish(); !status.ok()) return status.error();
  tree.stats.bytes = tree.bytes();
  return tree;
}

std::uint64_t EstimateFinishBytes(const BinaryTree& binary) {
  return std::visit([](const auto& tree) { return tree.bytes() + CollapseBytes(tree); }, binary);
}

// Upper bounds, derived from the limits of the builders; a usual mesh needs at most a third. A
// growing vector counts three times, because old and new storage exist together.
std::uint64_t EstimateBuildBytes(std::size_t triangle_count, BuildKind kind) {
  const std::uint64_t n = triangle_count;
  const std::uint64_t threads = std::max(1u, std::thread::hardware_concurrency());
  // Triangles in the subtrees that single threads build.
  const std::uint64_t serial = std::min(n, threads * KdBuildLimits::kTopReferences);
  constexpr std::uint64_t kFixed = 1 << 16;
  // Wide trees use huge pages; usual ones take 85 to 180 bytes a triangle, and twice as much while
  // they are built.
  constexpr std::uint64_t kWideFixed = std::uint64_t{4} << 20;
  constexpr std::uint64_t kUsualWide = 450;
  switch (kind) {
    case BuildKind::kBox:
      // The leaf has all triangles; eight bytes a triangle are a margin.
      return kFixed + kWideFixed +
             n * (sizeof(PrimitiveId) + sizeof(std::uint64_t) + sizeof(LeafBlock) / 8);
    case BuildKind::kBvh:
      // References, ids, and the nodes (two for each triangle), in pieces and assembled.
      return kFixed + kWideFixed +
             std::max(n * (sizeof(PrimitiveRef) + sizeof(PrimitiveId) + 4 * sizeof(BvhNode)) +
                          serial * (3 * 2 * sizeof(BvhNode)),
                      n * kUsualWide);
    default:
      break;
  }

  constexpr std::uint64_t kWeight = KdBuildLimits::kWeightPerTriangle;
  // A unit of weight in a finished subtree: at worst leaves as small as their weight allows, and
  // their parents.
  constexpr std::uint64_t kFinished =
      2 * (sizeof(KdNode) + sizeof(Bounds3f)) / KdBuildLimits::kLeafWeight + sizeof(PrimitiveId);
  // In a large node at most 3/8 of the weight are references; they exist twice while they are
  // distributed to the children. kd-cyclic sorts four lists of floats with a fifth as scratch.
  constexpr std::uint64_t kLarge = kWeight * 3 / 8 * (2 * sizeof(PrimitiveRef) + 5 * sizeof(float));
  // KdSubtreeBuilder: its stack, its piece, and the references of one node while they are
  // distributed.
  constexpr std::uint64_t kSubtree =
      3 * kWeight * (sizeof(PrimitiveRef) + kFinished) + 2 * 2 * sizeof(PrimitiveRef);
  // SweepBuilder: slots, sides and six events; the events of one node, kept and new; two more while
  // they are sorted.
  constexpr std::uint64_t kSweep =
      3 * (kWeight * (sizeof(PrimitiveRef) + 1 + 6 * sizeof(SplitEvent)) + 18 * sizeof(SplitEvent));
  const std::uint64_t scratch = serial * kSubtree +
                                std::min(n, threads * KdBuildLimits::kSweepReferences) * kSweep +
                                std::min(n, threads * kReferenceChunk) * 3 * sizeof(PrimitiveRef);
  const std::uint64_t splitting = n * std::max(kLarge, kWeight * kFinished) + scratch;
  // After that the scratch is freed, and the pieces are assembled.
  const std::uint64_t assembling = n * 2 * kWeight * kFinished;
  return kFixed + kWideFixed + std::max({splitting, assembling, n * kUsualWide});
}

}  // namespace kdray::core
