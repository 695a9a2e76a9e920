#include "core/wide/collapse.h"

#include <algorithm>
#include <array>
#include <limits>
#include <span>
#include <vector>

#include "core/base/parallel.h"

namespace kdray::core {

namespace {

constexpr std::size_t kWidth = WideNode::kWidth;

// A node of any binary structure. Depth first: the first child is the next node.
struct BinaryNode {
  Bounds3f bounds;
  std::uint32_t second = 0;  // the second child; of a leaf its first primitive
  std::uint32_t primitives = 0;
  int axis = kLeaf;  // along which the children lie apart
  bool first_is_above = false;

  static constexpr int kLeaf = 3;
  bool IsLeaf() const { return axis == kLeaf; }
  bool IsEmpty() const { return IsLeaf() && primitives == 0; }
  std::size_t Blocks() const { return BlocksOf(primitives); }
  static std::size_t BlocksOf(std::size_t primitives) {
    return (primitives + LeafBlock::kWidth - 1) / LeafBlock::kWidth;
  }
  // Whether a ray of this octant meets the first child first.
  bool FirstIsNear(unsigned octant) const {
    return ((octant >> static_cast<unsigned>(axis) & 1u) != 0) == first_is_above;
  }
};

// The cheapest forest of at most 1..8 wide subtrees that a binary subtree can become.
struct Forest {
  std::array<float, kWidth> cost;
  // [k]: places, of k + 1, for the first child; kWhole: the subtree is one node or leaf.
  std::array<std::uint8_t, kWidth> first;
  std::uint8_t inside;  // as one node: places for the first child, of eight
  static constexpr std::uint8_t kWhole = 0xff;
};

class Collapser {
 public:
  Collapser(const TriangleMesh& mesh, std::span<const BinaryNode> nodes,
            std::span<const PrimitiveId> primitives)
      : mesh_(mesh),
        nodes_(nodes),
        primitives_(primitives),
        forests_(nodes.size()),
        sizes_(nodes.size()) {}

  WideTree Make() {
    if (nodes_.empty() || nodes_[0].IsEmpty() || nodes_[0].bounds.IsEmpty()) return {};
    PlanSubtree(0, static_cast<std::uint32_t>(nodes_.size()));
    wide_.bounds = Widen(nodes_[0].bounds);
    // Counted first: so every subtree knows its place, and subtrees can be written in parallel.
    const Size size = Measure(0);
    wide_.nodes.resize(size.nodes);
    wide_.blocks.resize(size.blocks);
    wide_.root = Emit(0, {});
    wide_.stack_size = StackSize(wide_);
    return std::move(wide_);
  }

 private:
  // Binary nodes that are worth a task of their own.
  static constexpr std::uint32_t kTaskNodes = 8192;

  // A subtree's wide nodes and blocks; or where they begin.
  struct Size {
    std::uint32_t nodes = 0;
    std::uint32_t blocks = 0;
  };

  // The nodes [i, end) are one subtree.
  void PlanSubtree(std::uint32_t i, std::uint32_t end) {
    if (end - i <= kTaskNodes) {
      for (std::uint32_t k = end; k-- > i;) Plan(k);
      return;
    }
    const std::uint32_t second = nodes_[i].second;
    ParallelInvoke([&] { PlanSubtree(i + 1, second); }, [&] { PlanSubtree(second, end); });
    Plan(i);
  }

  void Plan(std::uint32_t i) {
    const BinaryNode& node = nodes_[i];
    Forest& forest = forests_[i];
    if (node.IsLeaf()) {
      forest.cost.fill(AreaOf(node) * static_cast<float>(node.Blocks()));
      forest.first.fill(Forest::kWhole);
      return;
    }
    const std::uint32_t a = i + 1;
    const std::uint32_t b = node.second;
    const auto best_division = [&](std::size_t places, float* cost) {
      std::uint8_t best = 0;
      *cost = std::numeric_limits<float>::infinity();
      for (std::size_t first = 0; first <= places; ++first) {
        const float total = CostOf(a, first) + CostOf(b, places - first);
        if (total < *cost) {
          *cost = total;
          best = static_cast<std::uint8_t>(first);
        }
      }
      return best;
    };
    float children = 0;
    forest.inside = best_division(kWidth, &children);
    const float whole = AreaOf(node) + children;
    for (std::size_t k = 0; k < kWidth; ++k) {
      float divided = 0;
      const std::uint8_t first = best_division(k + 1, &divided);
      const bool divide = divided < whole;
      forest.cost[k] = divide ? divided : whole;
      forest.first[k] = divide ? first : Forest::kWhole;
    }
  }

  float CostOf(std::uint32_t i, std::size_t places) const {
    if (nodes_[i].IsEmpty()) return 0;
    return places == 0 ? std::numeric_limits<float>::infinity() : forests_[i].cost[places - 1];
  }

  // Relative to the root's, plus a little, so that flat and tiny cells have a cost too.
  float AreaOf(const BinaryNode& node) const {
    const Bounds3d box{Vec3d(node.bounds.min), Vec3d(node.bounds.max)};
    return static_cast<float>(box.SurfaceArea()) + 0x1p-30f;
  }

  static Bounds3f Widen(const Bounds3f& bounds) {
    const Vec3d pad{kWidePad, kWidePad, kWidePad};
    return RoundOutward({Vec3d(bounds.min) - pad, Vec3d(bounds.max) + pad});
  }

  // The binary subtrees that become the children of one wide node, below first.
  struct Children {
    std::array<std::uint32_t, kWidth> roots;
    std::size_t size = 0;
  };
  void Gather(std::uint32_t i, std::size_t places, Children* children) const {
    if (nodes_[i].IsEmpty()) return;
    const std::uint8_t first = forests_[i].first[places - 1];
    if (first == Forest::kWhole) {
      children->roots[children->size++] = i;
      return;
    }
    Gather(i + 1, first, children);
    Gather(nodes_[i].second, places - first, children);
  }

  // Appends the numbers of children below `i` in the order in which a ray meets them.
  void FrontToBack(std::uint32_t i, std::size_t places, unsigned octant, const Children& children,
                   std::array<std::uint32_t, kWidth>* order, std::size_t* size) const {
    if (nodes_[i].IsEmpty()) return;
    const std::uint8_t first = forests_[i].first[places - 1];
    if (first == Forest::kWhole) {
      const auto* found = std::find(children.roots.begin(), children.roots.end(), i);
      (*order)[(*size)++] = static_cast<std::uint32_t>(found - children.roots.begin());
      return;
    }
    Divide(i, first, places, octant, children, order, size);
  }
  void Divide(std::uint32_t i, std::size_t first, std::size_t places, unsigned octant,
              const Children& children, std::array<std::uint32_t, kWidth>* order,
              std::size_t* size) const {
    const std::uint32_t a = i + 1;
    const std::uint32_t b = nodes_[i].second;
    if (nodes_[i].FirstIsNear(octant)) {
      FrontToBack(a, first, octant, children, order, size);
      FrontToBack(b, places - first, octant, children, order, size);
    } else {
      FrontToBack(b, places - first, octant, children, order, size);
      FrontToBack(a, first, octant, children, order, size);
    }
  }

  Children ChildrenOf(std::uint32_t i) const {
    Children children;
    Gather(i + 1, forests_[i].inside, &children);
    Gather(nodes_[i].second, kWidth - forests_[i].inside, &children);
    return children;
  }

  Size Measure(std::uint32_t i) {
    Size size;
    if (nodes_[i].IsLeaf()) {
      size.blocks = static_cast<std::uint32_t>(nodes_[i].Blocks());
    } else {
      size.nodes = 1;
      const Children children = ChildrenOf(i);
      for (std::size_t c = 0; c < children.size; ++c) {
        const Size below = Measure(children.roots[c]);
        size.nodes += below.nodes;
        size.blocks += below.blocks;
      }
    }
    sizes_[i] = size;
    return size;
  }

  // Writes a subtree to its place; what a parent calls it by.
  std::uint32_t Emit(std::uint32_t i, Size place) {
    const BinaryNode& node = nodes_[i];
    if (node.IsLeaf()) return EmitLeaf(node, place.blocks);
    const Children children = ChildrenOf(i);
    const std::uint32_t index = place.nodes;
    WideNode& wide = wide_.nodes[index];
    {
      for (std::size_t c = 0; c < kWidth; ++c) {
        Bounds3f box = Bounds3f::Empty();
        if (c < children.size) box = Widen(nodes_[children.roots[c]].bounds);
        for (int axis = 0; axis < 3; ++axis) {
          wide.low[axis][c] = box.min[axis];
          wide.high[axis][c] = box.max[axis];
        }
        wide.child[c] = WideChild::kEmpty;
      }
      for (unsigned octant = 0; octant < 8; ++octant) {
        std::array<std::uint32_t, kWidth> order{};
        std::size_t size = 0;
        Divide(i, forests_[i].inside, kWidth, octant, children, &order, &size);
        for (std::size_t c = size; c < kWidth; ++c) order[c] = static_cast<std::uint32_t>(c);
        std::uint32_t packed = 0;
        for (std::size_t c = 0; c < kWidth; ++c) packed |= order[kWidth - 1 - c] << (4 * c);
        wide.order[octant] = packed;
      }
    }
    std::array<Size, kWidth> places;
    ++place.nodes;
    for (std::size_t c = 0; c < children.size; ++c) {
      places[c] = place;
      place.nodes += sizes_[children.roots[c]].nodes;
      place.blocks += sizes_[children.roots[c]].blocks;
    }
    // A task for a child is worth its price where the child is large.
    const std::size_t grain = sizes_[i].nodes > kTaskNodes / 16 ? 1 : kWidth;
    ParallelFor(0, children.size, grain, [&](std::size_t first, std::size_t last) {
      for (std::size_t c = first; c < last; ++c) {
        wide.child[c] = Emit(children.roots[c], places[c]);
      }
    });
    return index;
  }

  std::uint32_t EmitLeaf(const BinaryNode& leaf, std::uint32_t first) {
    LeafBlock* block = &wide_.blocks[first];
    const auto ids = primitives_.subspan(leaf.second, leaf.primitives);
    mesh_.VisitVertices([&](auto vertices) {
      for (std::size_t begin = 0; begin < ids.size(); begin += LeafBlock::kWidth) {
        const std::size_t count = std::min(LeafBlock::kWidth, ids.size() - begin);
        FillBlock(ids.subspan(begin, count), vertices, block++);
      }
    });
    block[-1].id[0] |= LeafBlock::kLast;
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
  std::span<const BinaryNode> nodes_;
  std::span<const PrimitiveId> primitives_;
  std::vector<Forest> forests_;
  std::vector<Size> sizes_;  // of the subtrees that become wide nodes or leaves
  WideTree wide_;
};

std::uint64_t BytesFor(std::size_t nodes, std::size_t leaves, std::size_t blocks) {
  // A wide node has two children at least, so there are fewer of them than leaves.
  return nodes * (sizeof(BinaryNode) + sizeof(Forest) + 3 * sizeof(std::uint32_t)) +
         leaves * sizeof(WideNode) + blocks * sizeof(LeafBlock) + (std::uint64_t{4} << 20);
}

}  // namespace

std::uint64_t CollapseBytes(const KdTree& tree) {
  std::size_t leaves = 0, blocks = 0;
  for (const KdNode& node : tree.nodes) {
    if (!node.IsLeaf() || node.primitive_count() == 0) continue;
    ++leaves;
    blocks += BinaryNode::BlocksOf(node.primitive_count());
  }
  return BytesFor(tree.nodes.size(), leaves, blocks);
}

std::uint64_t CollapseBytes(const Bvh& bvh) {
  std::size_t leaves = 0, blocks = 0;
  for (const BvhNode& node : bvh.nodes) {
    if (!node.IsLeaf()) continue;
    ++leaves;
    blocks += BinaryNode::BlocksOf(node.primitive_count);
  }
  return BytesFor(bvh.nodes.size(), leaves, blocks);
}

std::uint64_t CollapseBytes(const BoxList& box) {
  return BytesFor(1, 1, BinaryNode::BlocksOf(box.primitives.size()));
}

WideTree Collapse(const TriangleMesh& mesh, const KdTree& tree) {
  std::vector<BinaryNode> nodes(tree.nodes.size());
  ParallelFor(0, nodes.size(), 16384, [&](std::size_t first, std::size_t last) {
    for (std::size_t i = first; i < last; ++i) {
      const KdNode& node = tree.nodes[i];
      nodes[i].bounds = tree.node_bounds[i];
      if (node.IsLeaf()) {
        nodes[i].second = node.first_primitive();
        nodes[i].primitives = node.primitive_count();
      } else {
        nodes[i].second = node.above_child();
        nodes[i].axis = node.axis();
      }
    }
  });
  return Collapser(mesh, nodes, tree.primitives).Make();
}

WideTree Collapse(const TriangleMesh& mesh, const Bvh& bvh) {
  std::vector<BinaryNode> nodes(bvh.nodes.size());
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    const BvhNode& node = bvh.nodes[i];
    nodes[i].bounds = node.bounds;
    nodes[i].second = node.offset;
    nodes[i].primitives = node.primitive_count;
    if (node.IsLeaf()) continue;
    // The children's centres are farthest apart along the axis.
    const Vec3f apart = bvh.nodes[node.offset].bounds.Center() - bvh.nodes[i + 1].bounds.Center();
    int axis = 0;
    for (int other = 1; other < 3; ++other) {
      if (std::abs(apart[other]) > std::abs(apart[axis])) axis = other;
    }
    nodes[i].axis = axis;
    nodes[i].first_is_above = apart[axis] < 0;
  }
  return Collapser(mesh, nodes, bvh.primitives).Make();
}

WideTree Collapse(const TriangleMesh& mesh, const BoxList& box) {
  std::vector<BinaryNode> nodes(1);
  nodes[0].bounds = box.bounds;
  nodes[0].primitives = static_cast<std::uint32_t>(box.primitives.size());
  return Collapser(mesh, nodes, box.primitives).Make();
}

}  // namespace kdray::core
