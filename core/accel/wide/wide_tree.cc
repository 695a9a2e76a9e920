// SPDX-License-Identifier: Apache-2.0
#include "core/accel/wide/wide_tree.h"

#include <algorithm>
#include <string>
#include <vector>

namespace kdray::core {

namespace {

Error Corrupt(const std::string& what) { return {ErrorCode::kCorrupt, "wide tree: " + what}; }

// Work of looking at a node or a block (CancelPoll).
constexpr std::uint64_t kNodeWork = 64;
constexpr std::uint64_t kBlockWork = 16;

bool IsInner(std::uint32_t child) { return (child & WideChild::kLeafBit) == 0; }

bool IsPermutation(std::uint32_t order) {
  unsigned seen = 0;
  for (std::size_t i = 0; i < WideNode::kWidth; ++i) seen |= 1u << (order >> (4 * i) & 15u);
  return seen == 0xff;
}

}  // namespace

std::uint32_t StackSize(const WideTree& tree, CancelPoll* poll) {
  // Backwards, because children come after their parents. While one child is traversed, its
  // siblings lie on the stack.
  std::vector<std::uint32_t> need(tree.nodes.size());
  for (std::size_t i = tree.nodes.size(); i-- > 0;) {
    if (poll->Spend(kNodeWork)) return 0;
    std::uint32_t children = 0;
    std::uint32_t deepest = 0;
    for (const std::uint32_t child : tree.nodes[i].child) {
      if (child == WideChild::kEmpty) continue;
      ++children;
      if (IsInner(child)) deepest = std::max(deepest, need[child]);
    }
    need[i] = std::max(children, children == 0 ? 0 : children - 1 + deepest);
  }
  return std::max<std::uint32_t>(1, need.empty() ? 0 : need[0]);
}

Status WideTree::Validate(std::size_t triangle_count, const CancelToken& cancel) const {
  if (bounds.IsEmpty() != (root == WideChild::kEmpty)) return Corrupt("bounds without a root");
  if (root == WideChild::kEmpty) {
    if (nodes.empty() && blocks.empty()) return {};
    return Corrupt("nodes without a root");
  }
  if (!IsFinite(bounds.min) || !IsFinite(bounds.max)) return Corrupt("the bounds are invalid");
  if (blocks.empty() || !blocks.back().IsLast()) return Corrupt("the last leaf has no end");

  const auto check_child = [&](std::uint32_t child, std::size_t first_node) {
    if (child == WideChild::kEmpty) return true;
    if (IsInner(child)) return child >= first_node && child < nodes.size();
    const std::uint32_t block = child & ~WideChild::kLeafBit;
    return block < blocks.size() && (block == 0 || blocks[block - 1].IsLast());
  };
  if (!check_child(root, 0) || (IsInner(root) && root != 0)) {
    return Corrupt("the root is out of range");
  }
  if (!IsInner(root) && !nodes.empty()) return Corrupt("nodes without a leaf");
  CancelPoll poll(cancel);
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    if (poll.Spend(kNodeWork)) return poll.ToError();
    for (const std::uint32_t child : nodes[i].child) {
      if (!check_child(child, i + 1)) {
        return Corrupt("node " + std::to_string(i) + " has a child that is out of range");
      }
    }
    for (const std::uint32_t order : nodes[i].order) {
      if (!IsPermutation(order)) {
        return Corrupt("node " + std::to_string(i) + " has an invalid order of children");
      }
    }
  }
  for (std::size_t i = 0; i < blocks.size(); ++i) {
    if (poll.Spend(kBlockWork)) return poll.ToError();
    for (std::size_t lane = 0; lane < LeafBlock::kWidth; ++lane) {
      const PrimitiveId id = blocks[i].IdOf(lane);
      if (id >= triangle_count && id != LeafBlock::kIdMask) {
        return Corrupt("block " + std::to_string(i) + " names triangle " + std::to_string(id) +
                       " of " + std::to_string(triangle_count));
      }
    }
  }
  const std::uint32_t needed = StackSize(*this, &poll);
  if (poll.stopped()) return poll.ToError();
  if (stack_size < needed) return Corrupt("the stack is too small");
  return {};
}

}  // namespace kdray::core
