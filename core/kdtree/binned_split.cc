#include "core/kdtree/binned_split.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "core/geometry/power_of_two.h"

namespace kdray::core {

namespace {

// 2^ExponentOf(x) <= x < 2 * that, for normal floats; for smaller ones the former does not hold.
int ExponentOf(float x) { return static_cast<int>(std::bit_cast<std::uint32_t>(x) >> 23) - 127; }

}  // namespace

PlaneGrid::PlaneGrid(const Bounds3f& bounds) {
  constexpr int kMinExponent = -126;
  for (int axis = 0; axis < 3; ++axis) {
    const float low = bounds.min[axis];
    const float high = bounds.max[axis];
    // 16 <= width / 2^exponent < 32, unless planes would then lie between neighbouring floats.
    const int exponent =
        std::max({ExponentOf(high - low) - 4,
                  ExponentOf(std::max(std::fabs(low), std::fabs(high))) - 23, kMinExponent});
    scale_[axis] = static_cast<float>(PowerOfTwo(-exponent));
    spacing_[axis] = static_cast<float>(PowerOfTwo(exponent));
    first_[axis] = static_cast<std::int32_t>(std::floor(low * scale_[axis]));
  }
}

void BinnedCounts::Counts::Add(const Counts& other) {
  for (std::size_t k = 0; k < begin.size(); ++k) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      begin[k][axis] += other.begin[k][axis];
      end[k][axis] += other.end[k][axis];
      planar[k][axis] += other.planar[k][axis];
    }
  }
  any_planar |= other.any_planar;
}

BinnedCounts::Counts BinnedCounts::Count(std::span<const Reference> references,
                                         const PlaneGrid& grid) {
  Counts counts;
  for (const Reference& reference : references) {
    // A number that is taken for a float is denormal, and the processor slow on it.
    const Int4 end_lanes = std::bit_cast<Int4>(HighOf(reference)) & Int4{-1, -1, -1, 0};
    const Int4 begin = grid.Floor(LowOf(reference));
    const Int4 end = grid.CeilingLessOne(std::bit_cast<Float4>(end_lanes));
    const Int4 planar = begin > end;
    for (int axis = 0; axis < 3; ++axis) {
      ++counts.begin[static_cast<std::size_t>(begin[axis] + 1)][static_cast<std::size_t>(axis)];
      ++counts.end[static_cast<std::size_t>(end[axis] + 1)][static_cast<std::size_t>(axis)];
    }
    if ((planar[0] | planar[1] | planar[2]) != 0) {
      counts.any_planar = true;
      for (int axis = 0; axis < 3; ++axis) {
        counts.planar[static_cast<std::size_t>(begin[axis] + 1)][static_cast<std::size_t>(axis)] -=
            static_cast<std::uint32_t>(planar[axis]);
      }
    }
  }
  return counts;
}

BinnedCounts::BinnedCounts(std::span<const Reference> references, const Bounds3f& bounds)
    : grid_(bounds),
      bounds_(bounds),
      triangles_(references.size()),
      counts_(ReduceReferences<Counts>(
          references, [this](std::span<const Reference> chunk) { return Count(chunk, grid_); })) {}

BinnedCounts::BestPlanes BinnedCounts::FindBestPlanes(const std::array<SplitSearch::Axis, 3>& axes,
                                                      const Bounds3f& cell) const {
  Float4 base = Fill4(0), slope = Fill4(0), low = Fill4(0), high = Fill4(0);
  Float4 first = Fill4(0), last = Fill4(0);  // planes lie between them
  for (int axis = 0; axis < 3; ++axis) {
    const SplitProbability& probability = axes[static_cast<std::size_t>(axis)].probability();
    if (!probability.IsValid()) continue;
    base[axis] = static_cast<float>(probability.base());
    slope[axis] = static_cast<float>(probability.slope());
    low[axis] = cell.min[axis];
    high[axis] = cell.max[axis];
    first[axis] = bounds_.min[axis];
    last[axis] = bounds_.max[axis];
  }
  const auto load = [](const std::array<std::uint32_t, 4>& v) { return std::bit_cast<Int4>(v); };
  const auto blocks = [](Int4 n) {  // SahCost::Subtree, unit: a block
    static_assert(SahCost::kBlock == 8);
    const Int4 up = n + 7;
    return n <= 16 ? ToFloat4(up >> 3) : ToFloat4(up) * 0.125f;
  };

  Float4 best_cost = Fill4(std::numeric_limits<float>::infinity());
  Int4 best_plane = Int4{} - 1, best_below = {}, best_above = {};
  Int4 below = load(counts_.begin[0]);
  Int4 above = static_cast<std::int32_t>(triangles_) - load(counts_.end[0]);
  for (int k = 0; k <= PlaneGrid::kBins; ++k) {
    const std::size_t bin = static_cast<std::size_t>(k) + 1;
    const Float4 position = grid_.Position(k);
    const Float4 probability_below = base + slope * (position - low);
    const Float4 probability_above = base + slope * (high - position);
    const auto consider = [&](Int4 b, Int4 a) {
      const Float4 tests = probability_below * blocks(b) + probability_above * blocks(a);
      const Int4 better = (tests < best_cost) & (position > first) & (position < last);
      best_cost = better ? tests : best_cost;
      best_plane = better ? Int4{} + k : best_plane;
      best_below = better ? below : best_below;
      best_above = better ? above : best_above;
    };
    if (counts_.any_planar) {
      const Int4 planar = load(counts_.planar[bin]);
      consider(below + planar, above);
      consider(below, above + planar);
    } else {
      consider(below, above);
    }
    below += load(counts_.begin[bin]);
    above -= load(counts_.end[bin]);
  }

  BestPlanes best;
  for (std::size_t a = 0; a < 3; ++a) {
    best.plane[a] = best_plane[a];
    best.below[a] = static_cast<std::uint32_t>(best_below[a]);
    best.above[a] = static_cast<std::uint32_t>(best_above[a]);
  }
  return best;
}

std::optional<SplitCandidate> BinnedCounts::FindSplit(const Bounds3f& cell,
                                                      const SahCost& cost) const {
  if (bounds_.IsEmpty()) return std::nullopt;
  SplitSearch search(cost, cell, triangles_);
  std::array<SplitSearch::Axis, 3> axes = {
      SplitSearch::Axis(&search, 0), SplitSearch::Axis(&search, 1), SplitSearch::Axis(&search, 2)};
  const BestPlanes best = FindBestPlanes(axes, cell);
  for (int axis = 0; axis < 3; ++axis) {
    const std::size_t a = static_cast<std::size_t>(axis);
    axes[a].ConsiderEmptyBelow(bounds_.min[axis]);
    if (best.plane[a] >= 0) {
      const std::size_t bin = static_cast<std::size_t>(best.plane[a]) + 1;
      axes[a].Consider(grid_.Position(best.plane[a])[axis], best.below[a], counts_.planar[bin][a],
                       best.above[a]);
    }
    axes[a].ConsiderEmptyAbove(bounds_.max[axis]);
  }
  return search.best();
}

}  // namespace kdray::core
