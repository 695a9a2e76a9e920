// SPDX-License-Identifier: Apache-2.0
// The common data of a kd-tree build's parts, and the tasks that a node gives to its children.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <utility>

#include "core/accel/build_monitor.h"
#include "core/accel/kdtree/kd_tree_builder.h"
#include "core/accel/kdtree/split.h"
#include "core/accel/sah_cost.h"
#include "core/geometry/bounds3.h"
#include "core/geometry/triangle_mesh.h"

namespace kdray::core {

/// The size limit of a subtree. The weight of a leaf is its number of triangles, at least
/// kLeafWeight (KdBuildLimits), so the number of nodes is bounded too. Every split divides its
/// node's budget between the children in proportion to their weight. With a shared counter instead,
/// the tree would depend on the order of threads.
class WeightBudget {
 public:
  explicit WeightBudget(std::uint64_t weight = 0) : weight_(weight) {}

  bool Allows(std::size_t below, std::size_t above) const {
    return WeightOf(below) + WeightOf(above) <= weight_;
  }
  /// The stricter rule for the large nodes at the top: at most three eighths of the budget. It
  /// limits the references that wait to be split, which are seven times as large as those in a
  /// finished leaf, to three per triangle.
  bool AllowsAtTop(std::size_t below, std::size_t above) const {
    return WeightOf(below) + WeightOf(above) <= weight_ / 8 * 3;
  }

  /// The below child's fraction of the node.
  static double BelowPart(std::size_t below, std::size_t above) {
    const double b = static_cast<double>(WeightOf(below));
    return b / (b + static_cast<double>(WeightOf(above)));
  }
  /// The children's budgets; only after Allows().
  std::pair<WeightBudget, WeightBudget> Divide(std::size_t below, std::size_t above) const {
    const std::uint64_t b = WeightOf(below);
    const std::uint64_t a = WeightOf(above);
    const std::uint64_t spare = weight_ - b - a;
    const std::uint64_t below_spare = spare * b / (b + a);  // weights are below 2^32: no overflow
    return {WeightBudget(b + below_spare), WeightBudget(a + spare - below_spare)};
  }

 private:
  static std::uint64_t WeightOf(std::size_t references) {
    return std::max<std::uint64_t>(KdBuildLimits::kLeafWeight, references);
  }

  std::uint64_t weight_;
};

/// The common data of one build.
struct KdBuildContext {
  const TriangleMesh& mesh;
  KdSplitRule rule;
  const SahCost& cost;
  int max_depth;
  BuildMonitor& monitor;
};

/// A subtree to build.
struct KdBuildTask {
  Bounds3f cell;
  int depth = 0;
  WeightBudget budget;
  double share = 1;  ///< of the whole build's progress

  /// The children's tasks; only if the budget allows them.
  std::pair<KdBuildTask, KdBuildTask> Divide(const SplitPlane& plane, std::size_t below,
                                             std::size_t above) const {
    const auto [below_budget, above_budget] = budget.Divide(below, above);
    const double below_share = share * WeightBudget::BelowPart(below, above);
    return {{plane.BelowCell(cell), depth + 1, below_budget, below_share},
            {plane.AboveCell(cell), depth + 1, above_budget, share - below_share}};
  }
};

}  // namespace kdray::core
