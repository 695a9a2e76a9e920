// SPDX-License-Identifier: Apache-2.0
#include "core/accel/kdtree/binned_split.h"

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
  const Int4 last = Floor(Float4{bounds.max.x, bounds.max.y, bounds.max.z, 0});
  planes_ = std::clamp(std::max({last[0], last[1], last[2]}) + 1, 0, kBins + 1);
}

BinnedCounts::Counts::Counts(const PlaneGrid& grid) : places(At(grid.planes(), 0)) {
  std::fill_n(begin.begin(), places, 0u);
  std::fill_n(end.begin(), places, 0u);
}

void BinnedCounts::Counts::AddPlanar(std::size_t place, std::uint32_t number) {
  if (!any_planar) std::fill_n(planar.begin(), places, 0u);
  any_planar = true;
  planar[place] += number;
}

void BinnedCounts::Counts::Add(const Counts& other) {
  for (std::size_t i = 0; i < places; ++i) {
    begin[i] += other.begin[i];
    end[i] += other.end[i];
    if (other.any_planar) AddPlanar(i, other.planar[i]);
  }
}

BinnedCounts::Counts BinnedCounts::Count(std::span<const PrimitiveRef> references,
                                         const PlaneGrid& grid) {
  // Places are small and not negative, so that as unsigned numbers they need not be widened.
  const auto places = [](Int4 k) {
    return std::bit_cast<Unsigned4>((k + 1) * 4 + Int4{0, 1, 2, 0});
  };
  Counts counts(grid);
  for (const PrimitiveRef& reference : references) {
    // A number that is taken for a float is denormal, and the processor slow on it.
    const Int4 end_lanes = std::bit_cast<Int4>(HighOf(reference)) & Int4{-1, -1, -1, 0};
    const Int4 begin = grid.Floor(LowOf(reference));
    const Int4 end = grid.CeilingLessOne(std::bit_cast<Float4>(end_lanes));
    const Unsigned4 begin_places = places(begin);
    const Unsigned4 end_places = places(end);
    for (int axis = 0; axis < 3; ++axis) {
      ++counts.begin[begin_places[axis]];
      ++counts.end[end_places[axis]];
    }
    const Int4 planar = begin > end;
    if ((planar[0] | planar[1] | planar[2]) != 0) {
      for (int axis = 0; axis < 3; ++axis) {
        counts.AddPlanar(begin_places[axis], static_cast<std::uint32_t>(-planar[axis]));
      }
    }
  }
  return counts;
}

BinnedCounts::BinnedCounts(std::span<const PrimitiveRef> references, const Bounds3f& bounds,
                           BuildMonitor* monitor)
    : grid_(bounds),
      bounds_(bounds),
      triangles_(references.size()),
      counts_(ReduceReferences<Counts>(
          references, monitor,
          [this](std::span<const PrimitiveRef> chunk) { return Count(chunk, grid_); })) {}

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
  const auto load = [](const Bins& bins, int k) {
    return std::bit_cast<Int4>(Load4(&bins[At(k, 0)]));
  };

  Float4 best_cost = Fill4(std::numeric_limits<float>::infinity());
  Int4 best_plane = Int4{} - 1;
  Int4 below = load(counts_.begin, -1);
  Int4 above = static_cast<std::int32_t>(triangles_) - load(counts_.end, -1);
  for (int k = 0; k < grid_.planes(); ++k) {
    const Float4 position = grid_.Position(k);
    const Float4 probability_below = base + slope * (position - low);
    const Float4 probability_above = base + slope * (high - position);
    const Int4 inside = (position > first) & (position < last);
    const auto consider = [&](Int4 b, Int4 a) {
      const Float4 tests = probability_below * SahCost::SubtreeEighths(b) +
                           probability_above * SahCost::SubtreeEighths(a);
      const Int4 better = (tests < best_cost) & inside;
      best_cost = better ? tests : best_cost;
      best_plane = better ? Int4{} + k : best_plane;
    };
    if (counts_.any_planar) {
      const Int4 planar = load(counts_.planar, k);
      consider(below + planar, above);
      consider(below, above + planar);
    } else {
      consider(below, above);
    }
    below += load(counts_.begin, k);
    above -= load(counts_.end, k);
  }

  BestPlanes best;
  for (std::size_t a = 0; a < 3; ++a) {
    best.plane[a] = best_plane[a];
    best.below[a] = 0;
    best.above[a] = static_cast<std::uint32_t>(triangles_);
    for (int k = -1; k < best_plane[a]; ++k) {
      best.below[a] += counts_.begin[At(k, a)];
      best.above[a] -= counts_.end[At(k, a)];
    }
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
      const std::uint32_t planar = counts_.any_planar ? counts_.planar[At(best.plane[a], a)] : 0;
      axes[a].Consider(grid_.Position(best.plane[a])[axis], best.below[a], planar, best.above[a]);
    }
    axes[a].ConsiderEmptyAbove(bounds_.max[axis]);
  }
  return search.best();
}

}  // namespace kdray::core
