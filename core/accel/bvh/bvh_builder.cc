// SPDX-License-Identifier: Apache-2.0
#include "core/accel/bvh/bvh_builder.h"

#include <algorithm>
#include <array>
#include <memory>
#include <optional>
#include <span>
#include <tuple>
#include <utility>
#include <vector>

#include "core/accel/build_monitor.h"
#include "core/accel/primitive_ref.h"
#include "core/base/parallel.h"
#include "core/base/polled_sort.h"

namespace kdray::core {

namespace {

constexpr std::size_t kBins = 16;
constexpr std::size_t kTopReferences = 16384;  // larger nodes are built in parallel
constexpr std::size_t kPollReferences = 4096;  // smaller ones do not ask about cancellation
// What a step of one thread's loop over references counts as (CancelPoll).
constexpr std::uint64_t kStepWork = 16;
// From here on nodes are halved by number; with 2^30 triangles that takes 30 levels more.
constexpr int kHalvingDepth = 32;
static_assert(kHalvingDepth + 31 <= Bvh::kMaxDepth);

float Center(const Bounds3f& bounds, int axis) {
  return bounds.min[axis] * 0.5f + bounds.max[axis] * 0.5f;
}

double Area(const Bounds3f& bounds) {
  return Bounds3d{Vec3d(bounds.min), Vec3d(bounds.max)}.SurfaceArea();
}

// Bins of equal width over the centres' range on one axis.
class BinScale {
 public:
  BinScale(const Bounds3f& centers, int axis)
      : axis_(axis), low_(static_cast<double>(centers.min[axis])) {
    const double width = static_cast<double>(centers.max[axis]) - low_;
    per_unit_ = width > 0 ? kBins / width : 0;
  }
  // False when all centres are at one place.
  bool IsValid() const { return per_unit_ > 0; }
  std::size_t BinOf(const Bounds3f& bounds) const {
    const double place = (static_cast<double>(Center(bounds, axis_)) - low_) * per_unit_;
    return std::min(kBins - 1, static_cast<std::size_t>(place));
  }
  int axis() const { return axis_; }

 private:
  int axis_;
  double low_;
  double per_unit_;
};

struct Bin {
  Bounds3f bounds = Bounds3f::Empty();
  std::size_t count = 0;

  void Add(const Bin& other) {
    bounds.Extend(other.bounds);
    count += other.count;
  }
};
using AxisBins = std::array<Bin, kBins>;

struct Bounding {
  Bounds3f bounds = Bounds3f::Empty();
  Bounds3f centers = Bounds3f::Empty();

  void Add(const Bounding& other) {
    bounds.Extend(other.bounds);
    centers.Extend(other.centers);
  }
};

struct BvhSplit {
  BinScale scale;
  std::size_t first_bin;  // of the second child
};

// The upper part, whose nodes are large: two children, or a subtree with offsets of children that
// count from its own beginning.
struct UpperNode {
  Bounds3f bounds;
  std::unique_ptr<UpperNode> first, second;
  std::vector<BvhNode> nodes;
};

class BvhBuilder {
 public:
  BvhBuilder(const TriangleMesh& mesh, const SahCost& cost, const BuildOptions& options)
      : cost_(cost), monitor_(options), references_(MakePrimitiveRefs(mesh, &monitor_)) {}

  Result<Bvh> Build() {
    // Then some references were never written.
    if (monitor_.ShouldStop()) return monitor_.Finish().error();
    UpperNode root;
    if (!references_.empty()) BuildTop(references_, 0, &root);

    Bvh bvh;
    if (!monitor_.ShouldStop()) {
      bvh.nodes.reserve(CountNodes(root));
      Assemble(&root, &bvh.nodes);
      bvh.primitives.reserve(references_.size());
      CancelPoll poll = monitor_.MakePoll();
      PolledLoop(references_.size(), kStepWork, &poll,
                 [&](std::size_t i) { bvh.primitives.push_back(references_.data()[i].id); });
    }
    const Status status = monitor_.Finish();
    if (!status.ok()) return status.error();
    return bvh;
  }

 private:
  void BuildTop(std::span<PrimitiveRef> references, int depth, UpperNode* node) {
    if (references.size() <= kTopReferences) {
      BuildNode(references, depth, &node->nodes);
      node->nodes.shrink_to_fit();
      return;
    }
    const std::size_t first = SplitNode(references, depth, &node->bounds);
    if (first == 0) {
      EmitLeaf(references, node->bounds, &node->nodes);
      return;
    }
    node->first = std::make_unique<UpperNode>();
    node->second = std::make_unique<UpperNode>();
    ParallelInvoke([&] { BuildTop(references.first(first), depth + 1, node->first.get()); },
                   [&] { BuildTop(references.subspan(first), depth + 1, node->second.get()); });
  }

  void BuildNode(std::span<PrimitiveRef> references, int depth, std::vector<BvhNode>* nodes) {
    Bounds3f bounds;
    const std::size_t first = SplitNode(references, depth, &bounds);
    if (first == 0) {
      EmitLeaf(references, bounds, nodes);
      return;
    }
    const std::size_t interior = nodes->size();
    nodes->push_back({bounds, 0, 0});
    BuildNode(references.first(first), depth + 1, nodes);
    (*nodes)[interior].offset = static_cast<std::uint32_t>(nodes->size());
    BuildNode(references.subspan(first), depth + 1, nodes);
  }

  // Orders the references so that the first child's come first, and says how many these are; 0 for
  // a leaf.
  std::size_t SplitNode(std::span<PrimitiveRef> references, int depth, Bounds3f* bounds) {
    const Bounding bounding = ReduceReferences<Bounding>(references, &monitor_, [](auto chunk) {
      Bounding b;
      for (const PrimitiveRef& reference : chunk) {
        b.bounds.Extend(reference.bounds);
        b.centers.Extend(Vec3f{Center(reference.bounds, 0), Center(reference.bounds, 1),
                               Center(reference.bounds, 2)});
      }
      return b;
    });
    *bounds = bounding.bounds;
    if (references.size() == 1) return 0;
    if (references.size() >= kPollReferences && monitor_.ShouldStop()) return 0;

    const std::optional<BvhSplit> split = FindSplit(references, bounding);
    if (!split) return 0;
    CancelPoll poll =
        references.size() < kPollReferences ? CancelPoll(CancelToken()) : monitor_.MakePoll();
    if (depth >= kHalvingDepth) return Halve(references, split->scale.axis(), &poll);
    std::size_t first = 0;
    PolledPartition(
        references, kStepWork, &poll,
        [&](const PrimitiveRef& r) { return split->scale.BinOf(r.bounds) < split->first_bin; },
        &first);
    return poll.stopped() ? 0 : first;
  }

  std::optional<BvhSplit> FindSplit(std::span<const PrimitiveRef> references,
                                    const Bounding& bounding) {
    const double area = Area(bounding.bounds);
    double best_cost = cost_.Subtree(references.size());
    std::optional<BvhSplit> best;
    for (int axis = 0; axis < 3; ++axis) {
      const BinScale scale(bounding.centers, axis);
      if (!scale.IsValid()) continue;
      struct Bins {
        AxisBins bins;
        void Add(const Bins& other) {
          for (std::size_t k = 0; k < kBins; ++k) bins[k].Add(other.bins[k]);
        }
      };
      const AxisBins bins = ReduceReferences<Bins>(references, &monitor_, [&](auto chunk) {
                              Bins b;
                              for (const PrimitiveRef& reference : chunk) {
                                b.bins[scale.BinOf(reference.bounds)].Add({reference.bounds, 1});
                              }
                              return b;
                            }).bins;

      AxisBins upward;  // [k]: bins k and above
      Bin sum;
      for (std::size_t k = kBins; k-- > 0;) {
        sum.Add(bins[k]);
        upward[k] = sum;
      }
      sum = Bin();
      for (std::size_t k = 1; k < kBins; ++k) {
        sum.Add(bins[k - 1]);
        if (sum.count == 0 || upward[k].count == 0) continue;
        const double split_cost = cost_.Split(Area(sum.bounds) / area, sum.count,
                                              Area(upward[k].bounds) / area, upward[k].count);
        if (split_cost < best_cost) {
          best_cost = split_cost;
          best = BvhSplit{scale, k};
        }
      }
    }
    return best;
  }

  // 0 when the poll has stopped.
  static std::size_t Halve(std::span<PrimitiveRef> references, int axis, CancelPoll* poll) {
    const std::size_t half = references.size() / 2;
    const auto less = [axis](const PrimitiveRef& a, const PrimitiveRef& b) {
      return std::tuple(Center(a.bounds, axis), a.id) < std::tuple(Center(b.bounds, axis), b.id);
    };
    return PolledNthElement(references, half, kStepWork, poll, less) ? half : 0;
  }

  void EmitLeaf(std::span<const PrimitiveRef> references, const Bounds3f& bounds,
                std::vector<BvhNode>* nodes) {
    const std::size_t offset = static_cast<std::size_t>(references.data() - references_.data());
    nodes->push_back({bounds, static_cast<std::uint32_t>(offset),
                      static_cast<std::uint32_t>(references.size())});
    monitor_.AddDone(static_cast<double>(references.size()) /
                     static_cast<double>(references_.size()));
  }

  static std::size_t CountNodes(const UpperNode& node) {
    if (!node.first) return node.nodes.size();
    return 1 + CountNodes(*node.first) + CountNodes(*node.second);
  }

  void Assemble(UpperNode* node, std::vector<BvhNode>* nodes) {
    if (monitor_.ShouldStop()) return;
    const std::uint32_t start = static_cast<std::uint32_t>(nodes->size());
    if (!node->first) {
      for (BvhNode n : node->nodes) {
        if (!n.IsLeaf()) n.offset += start;
        nodes->push_back(n);
      }
      std::vector<BvhNode>().swap(node->nodes);
      return;
    }
    nodes->push_back({node->bounds, 0, 0});
    Assemble(node->first.get(), nodes);
    (*nodes)[start].offset = static_cast<std::uint32_t>(nodes->size());
    Assemble(node->second.get(), nodes);
  }

  const SahCost& cost_;
  BuildMonitor monitor_;
  PrimitiveRefArray references_;
};

}  // namespace

Result<Bvh> BuildBvh(const TriangleMesh& mesh, const SahCost& cost, const BuildOptions& options) {
  return BvhBuilder(mesh, cost, options).Build();
}

TreeStats ComputeStats(const Bvh& bvh, const SahCost& cost, const CancelToken& cancel) {
  TreeStats stats;
  stats.nodes = bvh.nodes.size();
  stats.bytes = bvh.bytes();
  stats.traversal_cost = cost.traversal;
  stats.intersection_cost = cost.intersection;
  if (bvh.nodes.empty()) return stats;

  const double whole = Area(bvh.nodes[0].bounds);
  double weighed_cost = 0;
  std::vector<std::pair<std::uint32_t, std::uint32_t>> pending = {{0, 0}};  // node, depth
  CancelPoll poll(cancel);
  while (!pending.empty() && !poll.Spend(kStepWork)) {
    const auto [index, depth] = pending.back();
    pending.pop_back();
    const BvhNode& node = bvh.nodes[index];
    if (node.IsLeaf()) {
      CountLeaf(node.primitive_count, depth, &stats);
      weighed_cost += Area(node.bounds) * cost.Leaf(node.primitive_count);
      continue;
    }
    weighed_cost += Area(node.bounds) * cost.traversal;
    pending.emplace_back(node.offset, depth + 1);
    pending.emplace_back(index + 1, depth + 1);
  }
  if (whole > 0) stats.sah_cost = weighed_cost / whole;
  return stats;
}

}  // namespace kdray::core
