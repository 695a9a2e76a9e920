#include "core/kdtree/binned_split.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>

#include "core/base/float4.h"

namespace kdray::core {

namespace {

constexpr int kBins = 32;

// The planes of all axes, one axis a lane: plane k of an axis lies at (first + k) / scale. With a
// power of two for a scale, products are exact, so that floor and ceiling tell exactly which planes
// lie below a coordinate and which above.
class PlaneGrid {
 public:
  explicit PlaneGrid(const Bounds3f& bounds) {
    for (int axis = 0; axis < 3; ++axis) {
      const float low = bounds.min[axis];
      const float high = bounds.max[axis];
      int exponent = 0;  // of the distance between planes
      if (low < high) {
        // 16 < width / 2^exponent <= 32, unless planes would then lie between neighbouring floats.
        std::frexp(static_cast<double>(high) - static_cast<double>(low), &exponent);
        int coordinate_exponent;
        std::frexp(std::max(std::fabs(low), std::fabs(high)), &coordinate_exponent);
        exponent = std::max({exponent - 5, coordinate_exponent - 24, kMinExponent});
      }
      scale_[axis] = std::ldexp(1.0f, -exponent);
      spacing_[axis] = std::ldexp(1.0f, exponent);
      first_[axis] = static_cast<std::int32_t>(std::floor(low * scale_[axis]));
    }
  }

  /// For coordinates within the bounds, 0 to kBins: how many planes, from plane 0 on, do not lie
  /// above it, less one...
  Int4 Floor(Float4 coordinates) const {
    const Float4 scaled = coordinates * scale_;
    const Int4 truncated = Truncate4(scaled);
    return truncated - first_ + (ToFloat4(truncated) > scaled);  // a comparison gives -1 for true
  }
  /// ... and how many lie below it, less one.
  Int4 CeilingLessOne(Float4 coordinates) const {
    const Float4 scaled = coordinates * scale_;
    const Int4 truncated = Truncate4(scaled);
    return truncated - first_ - 1 - (ToFloat4(truncated) < scaled);
  }

  Float4 Position(int k) const { return ToFloat4(first_ + k) * spacing_; }

 private:
  static constexpr int kMinExponent = -126;

  Float4 scale_ = Fill4(0);
  Float4 spacing_ = Fill4(0);
  Int4 first_ = {};
};

// References by the planes that they begin and end at; a lane is an axis.
struct Counts {
  // [k + 1]: how many begin in bin k, between planes k and k + 1, or end there; ends in a plane
  // count for the bin that they are the end of.
  using Bins = std::array<std::array<std::uint32_t, 4>, kBins + 2>;
  Bins begin{}, end{};
  Bins planar{};  // [k + 1]: lie in plane k
  bool any_planar = false;

  void Add(const Counts& other) {
    for (std::size_t k = 0; k < begin.size(); ++k) {
      for (std::size_t axis = 0; axis < 3; ++axis) {
        begin[k][axis] += other.begin[k][axis];
        end[k][axis] += other.end[k][axis];
        planar[k][axis] += other.planar[k][axis];
      }
    }
    any_planar |= other.any_planar;
  }
};

Counts Count(std::span<const Reference> references, const PlaneGrid& grid) {
  Counts counts;
  for (const Reference& reference : references) {
    const Int4 begin = grid.Floor(LowOf(reference));
    const Int4 end = grid.CeilingLessOne(HighOf(reference));
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

// The cheapest plane of each axis, as far as floats can tell.
struct BestPlanes {
  std::array<int, 3> plane = {-1, -1, -1};  // -1: there is none
  std::array<std::uint32_t, 3> below, above;
};

BestPlanes FindBestPlanes(const Counts& counts, const PlaneGrid& grid, std::size_t triangles,
                          const Bounds3f& bounds, const Bounds3f& cell) {
  Float4 base = Fill4(0), slope = Fill4(0), low = Fill4(0), high = Fill4(0);
  Float4 first = Fill4(0), last = Fill4(0);  // planes lie between them
  for (int axis = 0; axis < 3; ++axis) {
    const SplitProbability probability(cell, axis);
    if (!probability.IsValid()) continue;
    base[axis] = static_cast<float>(probability.base());
    slope[axis] = static_cast<float>(probability.slope());
    low[axis] = cell.min[axis];
    high[axis] = cell.max[axis];
    first[axis] = bounds.min[axis];
    last[axis] = bounds.max[axis];
  }
  const auto load = [](const std::array<std::uint32_t, 4>& v) { return std::bit_cast<Int4>(v); };
  const auto blocks = [](Int4 n) {  // SahCost::Subtree, unit: a block
    static_assert(SahCost::kBlock == 8);
    const Int4 up = n + 7;
    return n <= 16 ? ToFloat4(up >> 3) : ToFloat4(up) * 0.125f;
  };

  Float4 best_cost = Fill4(std::numeric_limits<float>::infinity());
  Int4 best_plane = Int4{} - 1, best_below = {}, best_above = {};
  Int4 below = load(counts.begin[0]);
  Int4 above = static_cast<std::int32_t>(triangles) - load(counts.end[0]);
  for (int k = 0; k <= kBins; ++k) {
    const std::size_t bin = static_cast<std::size_t>(k) + 1;
    const Float4 position = grid.Position(k);
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
    if (counts.any_planar) {
      const Int4 planar = load(counts.planar[bin]);
      consider(below + planar, above);
      consider(below, above + planar);
    } else {
      consider(below, above);
    }
    below += load(counts.begin[bin]);
    above -= load(counts.end[bin]);
  }

  BestPlanes best;
  for (std::size_t a = 0; a < 3; ++a) {
    best.plane[a] = best_plane[a];
    best.below[a] = static_cast<std::uint32_t>(best_below[a]);
    best.above[a] = static_cast<std::uint32_t>(best_above[a]);
  }
  return best;
}

}  // namespace

std::optional<SplitCandidate> FindBinnedSplit(std::span<const Reference> references,
                                              const Bounds3f& bounds, const Bounds3f& cell,
                                              const SahCost& cost) {
  if (bounds.IsEmpty()) return std::nullopt;
  const PlaneGrid grid(bounds);
  const Counts counts = ReduceReferences<Counts>(
      references, [&](std::span<const Reference> chunk) { return Count(chunk, grid); });
  const BestPlanes best = FindBestPlanes(counts, grid, references.size(), bounds, cell);

  SplitSearch search(cost, cell, references.size());
  for (int axis = 0; axis < 3; ++axis) {
    const std::size_t a = static_cast<std::size_t>(axis);
    SplitSearch::Axis candidates(&search, axis);
    candidates.ConsiderEmptyBelow(bounds.min[axis]);
    if (best.plane[a] >= 0) {
      candidates.Consider(grid.Position(best.plane[a])[axis], best.below[a],
                          counts.planar[static_cast<std::size_t>(best.plane[a]) + 1][a],
                          best.above[a]);
    }
    candidates.ConsiderEmptyAbove(bounds.max[axis]);
  }
  return search.best();
}

}  // namespace kdray::core
