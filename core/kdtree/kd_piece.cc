#include "core/kdtree/kd_piece.h"

namespace kdray::core {

namespace {

struct Size {
  std::size_t nodes = 0;
  std::size_t primitives = 0;
};

Size Measure(const KdUpperNode& node) {
  if (!node.below) return {node.piece.nodes.size(), node.piece.primitives.size()};
  const Size below = Measure(*node.below);
  const Size above = Measure(*node.above);
  return {1 + below.nodes + above.nodes, below.primitives + above.primitives};
}

void AppendPiece(KdPiece piece, KdTree* tree) {
  const std::uint32_t first_node = static_cast<std::uint32_t>(tree->nodes.size());
  const std::uint32_t first_primitive = static_cast<std::uint32_t>(tree->primitives.size());
  for (const KdNode& node : piece.nodes) {
    tree->nodes.push_back(
        node.IsLeaf()
            ? KdNode::Leaf(first_primitive + node.first_primitive(), node.primitive_count())
            : KdNode::Interior(node.axis(), node.split(), first_node + node.above_child()));
  }
  tree->node_bounds.insert(tree->node_bounds.end(), piece.node_bounds.begin(),
                           piece.node_bounds.end());
  tree->primitives.insert(tree->primitives.end(), piece.primitives.begin(), piece.primitives.end());
}

void Append(KdUpperNode* node, KdTree* tree) {
  if (!node->below) {
    AppendPiece(std::move(node->piece), tree);
    return;
  }
  const std::size_t interior = tree->nodes.size();
  tree->nodes.emplace_back();
  tree->node_bounds.emplace_back();
  Append(node->below.get(), tree);
  const std::size_t above = tree->nodes.size();
  tree->nodes[interior] =
      KdNode::Interior(node->plane.axis, node->plane.position, static_cast<std::uint32_t>(above));
  Append(node->above.get(), tree);
  Bounds3f bounds = tree->node_bounds[interior + 1];
  bounds.Extend(tree->node_bounds[above]);
  tree->node_bounds[interior] = bounds;
}

}  // namespace

void Assemble(KdUpperNode* root, KdTree* tree) {
  const Size size = Measure(*root);
  tree->nodes.clear();
  tree->node_bounds.clear();
  tree->primitives.clear();
  tree->nodes.reserve(size.nodes);
  tree->node_bounds.reserve(size.nodes);
  tree->primitives.reserve(size.primitives);
  Append(root, tree);
}

}  // namespace kdray::core
