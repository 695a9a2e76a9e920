#include "core/wide/collapse.h"

#include <algorithm>
#include <array>
#include <limits>
#include <span>
#include <vector>

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
      : mesh_(mesh), nodes_(nodes), primitives_(primitives), forests_(nodes.size()) {}

  WideTree Make() {
    if (nodes_.empty() || nodes_[0].IsEmpty() || nodes_[0].bounds.IsEmpty()) return {};
    for (std::size_t i = nodes_.size(); i-- > 0;) Plan(static_cast<std::uint32_t>(i));
    wide_.bounds = Widen(nodes_[0].bounds);
    // Counted first, so that nothing is moved while it grows.
    wide_.nodes.reserve(CountNodes(0));
    std::size_t blocks = 0;
    for (const BinaryNode& node : nodes_) blocks += node.Blocks();
    wide_.blocks.reserve(blocks);
    wide_.root = Emit(0);
    wide_.stack_size = StackSize(wide_);
    return std::move(wide_);
  }

 private:
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

  std::size_t CountNodes(std::uint32_t i) const {
    if (nodes_[i].IsLeaf()) return 0;
    const Children children = ChildrenOf(i);
    std::size_t count = 1;
    for (std::size_t c = 0; c < children.size; ++c) count += CountNodes(children.roots[c]);
    return count;
  }

  std::uint32_t Emit(std::uint32_t i) {
    const BinaryNode& node = nodes_[i];
    if (node.IsLeaf()) return EmitLeaf(node);
    const Children children = ChildrenOf(i);
    const std::uint32_t index = static_cast<std::uint32_t>(wide_.nodes.size());
    wide_.nodes.emplace_back();
    {
      WideNode& wide = wide_.nodes.back();
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
    for (std::size_t c = 0; c < children.size; ++c) {
      const std::uint32_t child = Emit(children.roots[c]);
      wide_.nodes[index].child[c] = child;
    }
    return index;
  }

  std::uint32_t EmitLeaf(const BinaryNode& leaf) {
    const std::uint32_t first = static_cast<std::uint32_t>(wide_.blocks.size());
    const auto ids = primitives_.subspan(leaf.second, leaf.primitives);
    constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
    for (std::size_t begin = 0; begin < ids.size(); begin += LeafBlock::kWidth) {
      LeafBlock& block = wide_.blocks.emplace_back();
      for (std::size_t lane = 0; lane < LeafBlock::kWidth; ++lane) {
        const bool used = begin + lane < ids.size();
        block.id[lane] = used ? ids[begin + lane] : LeafBlock::kIdMask;
        for (int corner = 0; corner < 3; ++corner) {
          const Vec3f at =
              used ? Vec3f(mesh_.LocalCorner(block.id[lane], corner)) : Vec3f{kNan, kNan, kNan};
          for (int axis = 0; axis < 3; ++axis) block.corner[corner][axis][lane] = at[axis];
        }
      }
    }
    wide_.blocks.back().id[0] |= LeafBlock::kLast;
    return first | WideChild::kLeafBit;
  }

  const TriangleMesh& mesh_;
  std::span<const BinaryNode> nodes_;
  std::span<const PrimitiveId> primitives_;
  std::vector<Forest> forests_;
  WideTree wide_;
};

std::uint64_t BytesFor(std::size_t nodes, std::size_t leaves, std::size_t blocks) {
  // A wide node has two children at least, so there are fewer of them than leaves.
  return nodes * (sizeof(BinaryNode) + sizeof(Forest) + sizeof(std::uint32_t)) +
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
  for (std::size_t i = 0; i < nodes.size(); ++i) {
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
