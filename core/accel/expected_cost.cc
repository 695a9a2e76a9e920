// SPDX-License-Identifier: Apache-2.0
#include "core/accel/expected_cost.h"

#include <cstddef>
#include <cstdint>

#include "core/accel/wide/wide_tree.h"
#include "core/base/cancel_poll.h"
#include "core/geometry/bounds3.h"

namespace kdray::core {

Result<double> ExpectedCost(const Tree& tree, const CancelToken& cancel) {
  // Work of looking at a node or a block (CancelPoll).
  constexpr std::uint64_t kNodeWork = 32, kBlockWork = 8;
  const WideTree& wide = tree.wide;
  if (wide.root == WideChild::kEmpty) return 0.0;
  CancelPoll poll(cancel);
  const auto weight = [&](std::uint32_t child) {
    if ((child & WideChild::kLeafBit) == 0) return 1.0;
    const std::size_t first = child & ~WideChild::kLeafBit;
    std::size_t last = first;
    while (!wide.blocks[last].IsLast() && !poll.Spend(kBlockWork)) ++last;
    return static_cast<double>(last - first + 1);
  };
  // Boxes are enlarged by kWidePad, so every area is positive. The order of the sum is that of the
  // nodes, for any number of threads.
  const double whole = Bounds3d{Vec3d(wide.bounds.min), Vec3d(wide.bounds.max)}.SurfaceArea();
  double sum = whole * weight(wide.root);
  for (const WideNode& node : wide.nodes) {
    if (poll.Spend(kNodeWork)) break;
    for (std::size_t c = 0; c < WideNode::kWidth; ++c) {
      if (node.child[c] == WideChild::kEmpty) continue;
      Bounds3d box;
      for (int axis = 0; axis < 3; ++axis) {
        box.min[axis] = static_cast<double>(node.low[axis][c]);
        box.max[axis] = static_cast<double>(node.high[axis][c]);
      }
      sum += box.SurfaceArea() * weight(node.child[c]);
    }
  }
  if (poll.stopped()) return poll.ToError();
  return sum / whole;
}

}  // namespace kdray::core
