#include "core/kdtree/sweep_split.h"

#include <limits>

namespace kdray::core {

std::vector<double> SubtreeCosts(const SahCost& cost, std::size_t most) {
  std::vector<double> costs;
  for (std::size_t n = 0; n <= most; ++n) costs.push_back(cost.Subtree(n));
  return costs;
}

void SweepAxis(std::span<const SplitEvent> events, int axis, std::size_t triangles,
               std::span<const double> costs, SplitSearch* search) {
  using Kind = SplitEvent::Kind;
  SplitSearch::Axis candidates(search, axis);
  std::size_t below = 0;          // start below the plane
  std::size_t above = triangles;  // end above it
  std::size_t i = 0;
  while (i < events.size() && !candidates.IsAboveCellsLowEnd(events[i].position())) {
    above -= events[i].kind() != Kind::kStart;
    below += events[i].kind() != Kind::kEnd;
    ++i;
  }

  // A plane belongs to all events at one position, but each is tried as if the plane were its own:
  // that counts triangles too often before the last end and behind the first start, so the right
  // counts are among those tried, and nothing is cheaper than they are. Planar ones count above
  // before their own event and below behind it.
  const SplitProbability probability = candidates.probability();
  double best_cost = std::numeric_limits<double>::infinity();
  std::size_t best = 0, best_below = 0, best_above = 0;
  while (i < events.size() && candidates.IsBelowCellsHighEnd(events[i].position())) {
    const SplitEvent event = events[i];
    const float position = event.position();
    if (event.kind() != Kind::kPlanar) [[likely]] {
      const std::size_t start = event.kind() == Kind::kStart;
      above -= start ^ 1u;
      const double cost =
          probability.Below(position) * costs[below] + probability.Above(position) * costs[above];
      if (cost < best_cost) {
        best_cost = cost;
        best = i;
        best_below = below;
        best_above = above;
      }
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
    candidates.Consider(position, below, planar, above);
    below += planar;
  }
  if (best_cost < std::numeric_limits<double>::infinity()) {
    // The right counts of that plane. One that has planar triangles was shown with them already.
    const std::uint32_t at = events[best].OrderedPosition();
    const auto is = [&](std::size_t other, Kind kind) {
      return other < events.size() && events[other].kind() == kind &&
             events[other].OrderedPosition() == at;
    };
    std::size_t first = best, last = best;
    if (events[best].kind() == Kind::kEnd) {
      while (is(last + 1, Kind::kEnd)) ++last, --best_above;
    } else {
      while (first > 0 && is(first - 1, Kind::kStart)) --first, --best_below;
    }
    if (!is(last + 1, Kind::kPlanar) && !(first > 0 && is(first - 1, Kind::kPlanar))) {
      candidates.Consider(events[best].position(), best_below, 0, best_above);
    }
  }

  // The ends of them all, where a cut is cheaper for the empty space.
  if (events.empty()) return;
  candidates.ConsiderEmptyBelow(events.front().position());
  candidates.ConsiderEmptyAbove(events.back().position());
}

}  // namespace kdray::core
