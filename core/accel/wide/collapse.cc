// SPDX-License-Identifier: Apache-2.0
#include "core/accel/wide/collapse.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <span>

#include "core/base/parallel.h"

namespace kdray::core {

namespace {

constexpr std::size_t kWidth = WideNode::kWidth;

std::size_t BlocksOf(std::size_t primitives) {
  return (primitives + LeafBlock::kWidth - 1) / LeafBlock::kWidth;
}

// A common view of the binary structures. Depth first: an interior node's first child is the next
// node.
class KdView {
 public:
  explicit KdView(const KdTree& tree) : tree_(tree) {}

  std::uint32_t size() const { return static_cast<std::uint32_t>(tree_.nodes.size()); }
  bool IsLeaf(std::uint32_t i) const { return tree_.nodes[i].IsLeaf(); }
  std::uint32_t SecondChild(std::uint32_t i) const { return tree_.nodes[i].above_child(); }
  std::span<const PrimitiveId> Primitives(std::uint32_t leaf) const {
    const KdNode& node = tree_.nodes[leaf];
    return std::span(tree_.primitives).subspan(node.first_primitive(), node.primitive_count());
  }
  const Bounds3f& Bounds(std::uint32_t i) const { return tree_.node_bounds[i]; }

  // Bit k: whether a ray of octant k meets the first child of node i before the second.
  unsigned FirstIsNear(std::uint32_t i) const { return kUpward[tree_.nodes[i].axis()]; }
  // Octants whose direction is not negative along the axis.
  static constexpr unsigned kUpward[3] = {0b01010101, 0b00110011, 0b00001111};

 private:
  const KdTree& tree_;
};

class BvhView {
 public:
  explicit BvhView(const Bvh& bvh) : bvh_(bvh) {}

  std::uint32_t size() const { return static_cast<std::uint32_t>(bvh_.nodes.size()); }
  bool IsLeaf(std::uint32_t i) const { return bvh_.nodes[i].IsLeaf(); }
  std::uint32_t SecondChild(std::uint32_t i) const { return bvh_.nodes[i].offset; }
  std::span<const PrimitiveId> Primitives(std::uint32_t leaf) const {
    const BvhNode& node = bvh_.nodes[leaf];
    return std::span(bvh_.primitives).subspan(node.offset, node.primitive_count);
  }
  const Bounds3f& Bounds(std::uint32_t i) const { return bvh_.nodes[i].bounds; }

  // By the axis along which the children's centres are farthest apart.
  unsigned FirstIsNear(std::uint32_t i) const {
    const Vec3f apart = Bounds(SecondChild(i)).Center() - Bounds(i + 1).Center();
    int axis = 0;
    for (int other = 1; other < 3; ++other) {
      if (std::abs(apart[other]) > std::abs(apart[axis])) axis = other;
    }
    return apart[axis] < 0 ? KdView::kUpward[axis] ^ 0xffu : KdView::kUpward[axis];
  }

 private:
  const Bvh& bvh_;
};

class BoxView {
 public:
  explicit BoxView(const BoxList& box) : box_(box) {}

  std::uint32_t size() const { return 1; }
  bool IsLeaf(std::uint32_t) const { return true; }
  std::uint32_t SecondChild(std::uint32_t) const { return 0; }
  std::span<const PrimitiveId> Primitives(std::uint32_t) const { return box_.primitives; }
  const Bounds3f& Bounds(std::uint32_t) const { return box_.bounds; }
  unsigned FirstIsNear(std::uint32_t) const { return 0; }

 private:
  const BoxList& box_;
};

// The cheapest forests of at most 1..8 wide subtrees for a binary subtree.
struct Forest {
  std::array<float, kWidth> cost;
  // [k]: the first child's places of k + 1; kWhole: the subtree is one node or leaf.
  std::array<std::uint8_t, kWidth> first;
  std::uint8_t inside;  // as one node: the first child's places, of eight
  static constexpr std::uint8_t kWhole = 0xff;
};

// The numbers of a subtree's wide nodes and blocks, or their first positions.
struct Size {
  std::uint32_t nodes = 0;
  std::uint32_t blocks = 0;
};

template <class View>
class Collapser {
 public:
  Collapser(const TriangleMesh& mesh, const View& binary, BuildMonitor* monitor)
      : mesh_(mesh), binary_(binary), monitor_(*monitor) {}

  WideTree Make() {
    const std::uint32_t size = binary_.size();
    if (size == 0 || IsEmpty(0) || binary_.Bounds(0).IsEmpty()) return {};
    forests_ = std::make_unique_for_overwrite<Forest[]>(size);
    sizes_ = std::make_unique_for_overwrite<Size[]>(size);
    PlanSubtree(0, size);
    if (monitor_.ShouldStop()) return {};  // some plans are missing, here and below
    wide_.bounds = Widen(binary_.Bounds(0));
    // Counts first, so the position of every subtree is known and subtrees can be written in
    // parallel.
    wide_.stack_size = std::max<std::uint32_t>(1, Measure(0, size));
    if (monitor_.ShouldStop()) return {};
    wide_.nodes.resize(sizes_[0].nodes);
    wide_.blocks.resize(sizes_[0].blocks);
    wide_.root = Emit(0, {});
    return std::move(wide_);
  }

 private:
  // Binary nodes that are enough for a separate task.
  static constexpr std::uint32_t kTaskNodes = 8192;

  bool IsEmpty(std::uint32_t i) const { return binary_.IsLeaf(i) && binary_.Primitives(i).empty(); }

  // The nodes [i, end) are one subtree.
  void PlanSubtree(std::uint32_t i, std::uint32_t end) {
    if (end - i <= kTaskNodes) {
      if (monitor_.ShouldStop()) return;
      for (std::uint32_t k = end; k-- > i;) Plan(k);
      return;
    }
    const std::uint32_t second = binary_.SecondChild(i);
    ParallelInvoke([&] { PlanSubtree(i + 1, second); }, [&] { PlanSubtree(second, end); });
    Plan(i);
  }

  void Plan(std::uint32_t i) {
    Forest& forest = forests_[i];
    if (binary_.IsLeaf(i)) {
      const std::size_t blocks = BlocksOf(binary_.Primitives(i).size());
      forest.cost.fill(blocks == 0 ? 0 : AreaOf(i) * static_cast<float>(blocks));
      forest.first.fill(Forest::kWhole);
      return;
    }
    const std::uint32_t a = i + 1;
    const std::uint32_t b = binary_.SecondChild(i);
    const std::array<float, kWidth>& cost_a = forests_[a].cost;
    const std::array<float, kWidth>& cost_b = forests_[b].cost;
    // The best division of `places`; each child takes at least one, except an empty one.
    const std::size_t least_a = IsEmpty(a) ? 0 : 1;
    const std::size_t least_b = IsEmpty(b) ? 0 : 1;
    const auto best_division = [&](std::size_t places, float* cost) {
      std::uint8_t best = 0;
      *cost = std::numeric_limits<float>::infinity();
      for (std::size_t first = least_a; first + least_b <= places; ++first) {
        const float total = (first == 0 ? 0 : cost_a[first - 1]) +
                            (first == places ? 0 : cost_b[places - first - 1]);
        if (total < *cost) {
          *cost = total;
          best = static_cast<std::uint8_t>(first);
        }
      }
      return best;
    };
    float divided = 0;
    forest.inside = best_division(kWidth, &divided);
    const float whole = AreaOf(i) + divided;
    for (std::size_t k = kWidth; k-- > 0;) {
      const std::uint8_t first = k + 1 == kWidth ? forest.inside : best_division(k + 1, &divided);
      const bool divide = divided < whole;
      forest.cost[k] = divide ? divided : whole;
      forest.first[k] = divide ? first : Forest::kWhole;
    }
  }

  // Relative to the root's area, plus a small constant, so flat and tiny cells have a cost too.
  float AreaOf(std::uint32_t i) const {
    const Bounds3f& bounds = binary_.Bounds(i);
    const Bounds3d box{Vec3d(bounds.min), Vec3d(bounds.max)};
    return static_cast<float>(box.SurfaceArea()) + 0x1p-30f;
  }

  static Bounds3f Widen(const Bounds3f& bounds) {
    const Vec3d pad{kWidePad, kWidePad, kWidePad};
    return RoundOutward({Vec3d(bounds.min) - pad, Vec3d(bounds.max) + pad});
  }

  // The binary subtrees that become the children of one wide node, in depth-first order.
  struct Children {
    std::array<std::uint32_t, kWidth> roots;
    std::uint32_t size = 0;
  };
  Children ChildrenOf(std::uint32_t i) const {
    Children children;
    Gather(i + 1, forests_[i].inside, &children);
    Gather(binary_.SecondChild(i), kWidth - forests_[i].inside, &children);
    return children;
  }
  void Gather(std::uint32_t i, std::size_t places, Children* children) const {
    if (IsEmpty(i)) return;
    const std::uint8_t first = forests_[i].first[places - 1];
    if (first == Forest::kWhole) {
      children->roots[children->size++] = i;
      return;
    }
    Gather(i + 1, first, children);
    Gather(binary_.SecondChild(i), places - first, children);
  }

  // Orders of some children of a wide node, back to front for each octant, four bits each as in
  // WideNode::order.
  struct Orders {
    std::array<std::uint32_t, 8> packed{};
    std::uint32_t size = 0;
  };
  // Of all children of the wide node i.
  Orders OrdersOf(std::uint32_t i) const {
    std::uint32_t next = 0;
    Orders orders = Divided(i, forests_[i].inside, kWidth, &next);
    // Missing children come after the others in a ray's order, in descending order.
    constexpr std::uint32_t kBackward = 0x01234567;
    const std::size_t bits = 4 * (kWidth - orders.size);
    const std::uint64_t behind = kBackward & ((std::uint64_t{1} << bits) - 1);
    for (std::uint32_t& packed : orders.packed) {
      packed = static_cast<std::uint32_t>(std::uint64_t{packed} << bits | behind);
    }
    return orders;
  }
  // `next` is the number of the next child.
  Orders OrdersBelow(std::uint32_t i, std::size_t places, std::uint32_t* next) const {
    if (IsEmpty(i)) return {};
    const std::uint8_t first = forests_[i].first[places - 1];
    if (first != Forest::kWhole) return Divided(i, first, places, next);
    Orders orders;
    orders.packed.fill((*next)++);
    orders.size = 1;
    return orders;
  }
  Orders Divided(std::uint32_t i, std::size_t first, std::size_t places,
                 std::uint32_t* next) const {
    const Orders a = OrdersBelow(i + 1, first, next);
    const Orders b = OrdersBelow(binary_.SecondChild(i), places - first, next);
    if (a.size == 0) return b;
    if (b.size == 0) return a;
    const unsigned first_is_near = binary_.FirstIsNear(i);
    Orders both;
    both.size = a.size + b.size;
    for (unsigned octant = 0; octant < 8; ++octant) {
      both.packed[octant] = (first_is_near >> octant & 1u) != 0
                                ? b.packed[octant] | a.packed[octant] << (4 * b.size)
                                : a.packed[octant] | b.packed[octant] << (4 * a.size);
    }
    return both;
  }

  // Fills in sizes_ for the subtree [i, end), and returns the entries that a traversal's stack
  // needs there (WideTree::stack_size).
  std::uint32_t Measure(std::uint32_t i, std::uint32_t end) {
    Size& size = sizes_[i];
    if (binary_.IsLeaf(i)) {
      size = {0, static_cast<std::uint32_t>(BlocksOf(binary_.Primitives(i).size()))};
      return 0;
    }
    if (end - i > kTaskNodes && monitor_.ShouldStop()) return 0;
    const Children children = ChildrenOf(i);
    std::array<std::uint32_t, kWidth> needs{};
    ForEachChild(children, end - i, [&](std::size_t c) {
      // The nodes between two children are empty leaves.
      needs[c] = Measure(children.roots[c], c + 1 < children.size ? children.roots[c + 1] : end);
    });
    size = {1, 0};
    std::uint32_t deepest = 0;
    for (std::size_t c = 0; c < children.size; ++c) {
      size.nodes += sizes_[children.roots[c]].nodes;
      size.blocks += sizes_[children.roots[c]].blocks;
      deepest = std::max(deepest, needs[c]);
    }
    return std::max(children.size, children.size + deepest - 1);
  }

  // f(c) for each child of a wide node over `nodes` binary nodes; in parallel tasks if there are
  // enough nodes.
  template <class F>
  static void ForEachChild(const Children& children, std::size_t nodes, const F& f) {
    ParallelFor(0, children.size, nodes > kTaskNodes ? 1 : kWidth,
                [&](std::size_t first, std::size_t last) {
                  for (std::size_t c = first; c < last; ++c) f(c);
                });
  }

  // Writes a subtree to its place. Returns its number for WideNode::child.
  std::uint32_t Emit(std::uint32_t i, Size place) {
    if (binary_.IsLeaf(i)) return EmitLeaf(binary_.Primitives(i), place.blocks);
    // A wide node replaces some eight binary ones.
    const std::size_t nodes = std::size_t{8} * sizes_[i].nodes;
    if (nodes > kTaskNodes && monitor_.ShouldStop()) return WideChild::kEmpty;
    const Children children = ChildrenOf(i);
    const std::uint32_t index = place.nodes;
    WideNode& wide = wide_.nodes[index];
    for (std::size_t c = 0; c < kWidth; ++c) {
      const Bounds3f box =
          c < children.size ? Widen(binary_.Bounds(children.roots[c])) : Bounds3f::Empty();
      for (int axis = 0; axis < 3; ++axis) {
        wide.low[axis][c] = box.min[axis];
        wide.high[axis][c] = box.max[axis];
      }
      wide.child[c] = WideChild::kEmpty;
    }
    const Orders orders = OrdersOf(i);
    std::copy(orders.packed.begin(), orders.packed.end(), wide.order);

    std::array<Size, kWidth> places;
    ++place.nodes;
    for (std::size_t c = 0; c < children.size; ++c) {
      places[c] = place;
      place.nodes += sizes_[children.roots[c]].nodes;
      place.blocks += sizes_[children.roots[c]].blocks;
    }
    ForEachChild(children, nodes,
                 [&](std::size_t c) { wide.child[c] = Emit(children.roots[c], places[c]); });
    return index;
  }

  std::uint32_t EmitLeaf(std::span<const PrimitiveId> ids, std::uint32_t first) {
    LeafBlock* block = &wide_.blocks[first];
    const bool is_large = ids.size() > kTaskNodes;
    mesh_.VisitVertices([&](auto vertices) {
      for (std::size_t begin = 0; begin < ids.size(); begin += LeafBlock::kWidth) {
        if (is_large && begin % kTaskNodes == 0 && monitor_.ShouldStop()) return;
        const std::size_t count = std::min(LeafBlock::kWidth, ids.size() - begin);
        FillBlock(ids.subspan(begin, count), vertices, block++);
      }
    });
    wide_.blocks[first + BlocksOf(ids.size()) - 1].id[0] |= LeafBlock::kLast;
    return first | WideChild::kLeafBit;
  }

  template <class Vertices>
  void FillBlock(std::span<const PrimitiveId> ids, const Vertices& vertices,
                 LeafBlock* block) const {
    constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
    for (std::size_t lane = 0; lane < LeafBlock::kWidth; ++lane) {
      const bool used = lane < ids.size();
      block->id[lane] = used ? ids[lane] : LeafBlock::kIdMask;
      for (std::size_t corner = 0; corner < 3; ++corner) {
        Vec3f at{kNan, kNan, kNan};
        if (used) at = Vec3f(vertices[mesh_.triangles()[ids[lane]][corner]]);
        for (int axis = 0; axis < 3; ++axis) block->corner[corner][axis][lane] = at[axis];
      }
    }
  }

  const TriangleMesh& mesh_;
  const View& binary_;
  BuildMonitor& monitor_;
  std::unique_ptr<Forest[]> forests_;
  std::unique_ptr<Size[]> sizes_;  // by binary node, for those that become wide nodes or leaves
  WideTree wide_;
};

std::uint64_t BytesFor(std::size_t nodes, std::size_t leaves, std::size_t blocks) {
  // A wide node has at least two children, so there are fewer wide nodes than leaves.
  return nodes * (sizeof(Forest) + sizeof(Size)) + leaves * sizeof(WideNode) +
         blocks * sizeof(LeafBlock) + (std::uint64_t{4} << 20);
}

}  // namespace

std::uint64_t CollapseBytes(const KdTree& tree) {
  std::size_t leaves = 0, blocks = 0;
  for (const KdNode& node : tree.nodes) {
    if (!node.IsLeaf() || node.primitive_count() == 0) continue;
    ++leaves;
    blocks += BlocksOf(node.primitive_count());
  }
  return BytesFor(tree.nodes.size(), leaves, blocks);
}

std::uint64_t CollapseBytes(const Bvh& bvh) {
  std::size_t leaves = 0, blocks = 0;
  for (const BvhNode& node : bvh.nodes) {
    if (!node.IsLeaf()) continue;
    ++leaves;
    blocks += BlocksOf(node.primitive_count);
  }
  return BytesFor(bvh.nodes.size(), leaves, blocks);
}

std::uint64_t CollapseBytes(const BoxList& box) {
  return BytesFor(1, 1, BlocksOf(box.primitives.size()));
}

WideTree Collapse(const TriangleMesh& mesh, const KdTree& tree, BuildMonitor* monitor) {
  return Collapser(mesh, KdView(tree), monitor).Make();
}

WideTree Collapse(const TriangleMesh& mesh, const Bvh& bvh, BuildMonitor* monitor) {
  return Collapser(mesh, BvhView(bvh), monitor).Make();
}

WideTree Collapse(const TriangleMesh& mesh, const BoxList& box, BuildMonitor* monitor) {
  return Collapser(mesh, BoxView(box), monitor).Make();
}

}  // namespace kdray::core
