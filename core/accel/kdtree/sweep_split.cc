// SPDX-License-Identifier: Apache-2.0
#include "core/accel/kdtree/sweep_split.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>

namespace kdray::core {

std::vector<double> SubtreeCosts(const SahCost& cost, std::size_t most) {
  std::vector<double> costs;
  for (std::size_t n = 0; n <= most; ++n) costs.push_back(cost.Subtree(n));
  return costs;
}

namespace {

// The event whose cut is cheapest when each is tried as if its plane were its own: the first of
// equals.
struct BestEvent {
  static constexpr std::size_t kNone = ~std::size_t{0};
  double cost = std::numeric_limits<double>::infinity();
  std::size_t event = kNone;
  std::size_t below = 0;  // start below the plane
  std::size_t above = 0;  // end above it

  void Offer(double other_cost, std::size_t other, std::size_t other_below,
             std::size_t other_above) {
    if (other_cost >= cost) return;
    cost = other_cost;
    event = other;
    below = other_below;
    above = other_above;
  }
};

double CostAt(float position, std::size_t below, std::size_t above,
              const SplitProbability& probability, std::span<const double> costs) {
  return probability.Below(position) * costs[below] + probability.Above(position) * costs[above];
}

// One event after the other. Planes with triangles in them are shown to `candidates` at once;
// planar triangles count above before their own event and below after it.
BestEvent FindBest(std::span<const SplitEvent> events, std::size_t triangles,
                   std::span<const double> costs, SplitSearch::Axis* candidates) {
  using Kind = SplitEvent::Kind;
  std::size_t below = 0;
  std::size_t above = triangles;
  std::size_t i = 0;
  while (i < events.size() && !candidates->IsAboveCellsLowEnd(events[i].position())) {
    above -= events[i].kind() != Kind::kStart;
    below += events[i].kind() != Kind::kEnd;
    ++i;
  }
  BestEvent best;
  while (i < events.size() && candidates->IsBelowCellsHighEnd(events[i].position())) {
    const SplitEvent event = events[i];
    const float position = event.position();
    if (event.kind() != Kind::kPlanar) [[likely]] {
      const std::size_t start = event.kind() == Kind::kStart;
      above -= start ^ 1u;
      best.Offer(CostAt(position, below, above, candidates->probability(), costs), i, below, above);
      below += start;
      ++i;
      continue;
    }
    std::size_t planar = 0;
    while (i < events.size() && events[i].kind() == Kind::kPlanar &&
           events[i].OrderedPosition() == event.OrderedPosition()) {
      ++planar;
      ++i;
    }
    above -= planar;
    candidates->Consider(position, below, planar, above);
    below += planar;
  }
  return best;
}

// The same where no triangle is planar, four events at a time: costs in floats first, then exactly
// for the few that come near the least. Of the first i + 1 events, those that are no starts are
// ends, so one running sum gives both counts.
class FourAtATime {
 public:
  static constexpr std::size_t kMost = 512;    // events
  static constexpr double kSteepest = 0x1p60;  // slope of a probability

  FourAtATime(std::span<const SplitEvent> events, std::size_t triangles,
              const SplitSearch::Axis& candidates)
      : events_(events), triangles_(static_cast<std::int32_t>(triangles)), candidates_(candidates) {
    Float4 least = Fill4(std::numeric_limits<float>::infinity());
    std::size_t i = 0;
    for (; i + 4 <= events.size(); i += 4) least = Min4(least, Approximate(&events[i], i));
    if (i < events.size()) {
      SplitEvent last[4];  // the unused ones lie beyond the cell
      std::fill_n(last, 4, SplitEvent(std::numeric_limits<float>::infinity(), {}, 0));
      std::copy(events.begin() + static_cast<std::ptrdiff_t>(i), events.end(), last);
      least = Min4(least, Approximate(last, i));
    }
    least_ = std::min({least[0], least[1], least[2], least[3]});
  }

  BestEvent Best(std::span<const double> costs) const {
    // A float cost is off by less than 16 roundings; and where a coordinate is denormal beside the
    // cell's end, by less than 2^-149 * kSteepest.
    const Float4 limit = Fill4(least_ * (1 + 0x1p-18f) + 0x1p-60f);
    BestEvent best;
    for (std::size_t i = 0; i < events_.size(); i += 4) {
      const Int4 near = Load4(&costs_[i]) <= limit;
      if ((near[0] | near[1] | near[2] | near[3]) == 0) continue;
      for (std::size_t k = i; k < std::min(i + 4, events_.size()); ++k) {
        if (near[k - i] == 0) continue;
        const SplitEvent event = events_[k];
        const std::size_t starts = static_cast<std::size_t>(starts_[k]);
        const std::size_t below = starts - (event.kind() == SplitEvent::Kind::kStart ? 1 : 0);
        const std::size_t above = static_cast<std::size_t>(triangles_) - (k + 1 - starts);
        best.Offer(CostAt(event.position(), below, above, candidates_.probability(), costs), k,
                   below, above);
      }
    }
    return best;
  }

  // Whether floats can hold the numbers.
  static bool IsSuitable(std::span<const SplitEvent> events, std::size_t triangles,
                         const SplitProbability& probability) {
    return events.size() == 2 * triangles && events.size() <= kMost && probability.IsValid() &&
           probability.slope() < kSteepest;
  }

 private:
  // Of events [first, first + 4), which lie at `events`; infinite where they are not in the cell.
  Float4 Approximate(const SplitEvent* events, std::size_t first) {
    const SplitEvent::Four four(events);
    const Float4 position = four.positions();
    const Int4 is_start = four.are_starts();  // -1, as comparisons give
    // Sums over the lanes up to each.
    Int4 sum = is_start + __builtin_shufflevector(is_start, Int4{}, 4, 0, 1, 2);
    sum += __builtin_shufflevector(sum, Int4{}, 4, 4, 0, 1);
    const Int4 starts = carry_ - sum;
    carry_ = __builtin_shufflevector(starts, starts, 3, 3, 3, 3);
    const Int4 below = starts + is_start;
    const Int4 above = starts + (triangles_ - static_cast<std::int32_t>(first)) - Int4{1, 2, 3, 4};

    const SplitProbability& probability = candidates_.probability();
    const Float4 base = Fill4(static_cast<float>(probability.base()));
    const Float4 slope = Fill4(static_cast<float>(probability.slope()));
    const Float4 low = Fill4(candidates_.low());
    const Float4 high = Fill4(candidates_.high());
    const Float4 cost = (base + slope * (position - low)) * SahCost::SubtreeEighths(below) +
                        (base + slope * (high - position)) * SahCost::SubtreeEighths(above);
    const Int4 inside = (position > low) & (position < high);
    const Float4 offered = inside ? cost : Fill4(std::numeric_limits<float>::infinity());
    std::memcpy(&costs_[first], &offered, sizeof offered);
    std::memcpy(&starts_[first], &starts, sizeof starts);
    return offered;
  }

  std::span<const SplitEvent> events_;
  std::int32_t triangles_;
  const SplitSearch::Axis& candidates_;
  Int4 carry_ = {};
  float least_;
  std::array<float, kMost> costs_;
  std::array<std::int32_t, kMost> starts_;  // among the events up to each
};

}  // namespace

void SweepAxis(std::span<const SplitEvent> events, int axis, std::size_t triangles,
               std::span<const double> costs, SplitSearch* search) {
  using Kind = SplitEvent::Kind;
  SplitSearch::Axis candidates(search, axis);
  // A plane belongs to all events at one position, but each is tried as if the plane were its own:
  // that counts triangles too often before the last end and after the first start, so the right
  // counts are among those tried, and nothing is cheaper than they are.
  BestEvent best = FourAtATime::IsSuitable(events, triangles, candidates.probability())
                       ? FourAtATime(events, triangles, candidates).Best(costs)
                       : FindBest(events, triangles, costs, &candidates);
  if (best.event != BestEvent::kNone) {
    // The right counts of that plane. One that has planar triangles was shown with them already.
    const std::uint32_t at = events[best.event].OrderedPosition();
    const auto is = [&](std::size_t other, Kind kind) {
      return other < events.size() && events[other].kind() == kind &&
             events[other].OrderedPosition() == at;
    };
    std::size_t first = best.event, last = best.event;
    if (events[best.event].kind() == Kind::kEnd) {
      while (is(last + 1, Kind::kEnd)) ++last, --best.above;
    } else {
      while (first > 0 && is(first - 1, Kind::kStart)) --first, --best.below;
    }
    if (!is(last + 1, Kind::kPlanar) && !(first > 0 && is(first - 1, Kind::kPlanar))) {
      candidates.Consider(events[best.event].position(), best.below, 0, best.above);
    }
  }

  // The ends of them all, where a cut is cheaper for the empty space.
  if (events.empty()) return;
  candidates.ConsiderEmptyBelow(events.front().position());
  candidates.ConsiderEmptyAbove(events.back().position());
}

}  // namespace kdray::core
