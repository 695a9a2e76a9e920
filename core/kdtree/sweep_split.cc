#include "core/kdtree/sweep_split.h"

namespace kdray::core {

void SweepAxis(std::span<const SplitEvent> events, int axis, std::size_t triangles,
               SplitSearch* search) {
  using Kind = SplitEvent::Kind;
  SplitSearch::Axis candidates(search, axis);
  std::size_t below = 0;          // start below the plane
  std::size_t above = triangles;  // end above it
  std::size_t i = 0;
  const auto pass = [&] {
    above -= events[i].kind() != Kind::kStart;
    below += events[i].kind() != Kind::kEnd;
    ++i;
  };
  while (i < events.size() && !candidates.IsAboveCellsLowEnd(events[i].position())) pass();

  // A plane belongs to all events at one position, but each is shown as if the plane were its own:
  // that counts triangles too often before the last end and behind the first start, so the right
  // counts are among those shown, and nothing is cheaper than they are. Planar ones count above
  // before their own event and below behind it.
  while (i < events.size() && candidates.IsBelowCellsHighEnd(events[i].position())) {
    const SplitEvent event = events[i];
    if (event.kind() != Kind::kPlanar) {
      const bool start = event.kind() == Kind::kStart;
      above -= !start;
      candidates.ConsiderInside(event.position(), below, above, start);
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
    candidates.Consider(event.position(), below, planar, above);
    below += planar;
  }
}

}  // namespace kdray::core
