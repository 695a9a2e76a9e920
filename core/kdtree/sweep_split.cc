#include "core/kdtree/sweep_split.h"

#include <array>

namespace kdray::core {

void SweepAxis(std::span<const SplitEvent> events, int axis, std::size_t triangles,
               SplitSearch* search) {
  SplitSearch::Axis candidates(search, axis);
  std::size_t below = 0;          // start below the plane
  std::size_t above = triangles;  // end above it
  for (std::size_t i = 0; i < events.size();) {
    const SplitEvent& first = events[i];
    std::array<std::size_t, 3> at_plane{};  // by kind
    do {
      ++at_plane[static_cast<std::size_t>(events[i].kind())];
      ++i;
    } while (i < events.size() && events[i].OrderedPosition() == first.OrderedPosition());
    const auto [ends, planar, starts] = at_plane;
    above -= ends + planar;
    candidates.Consider(first.position(), below, planar, above);
    below += starts + planar;
  }
}

}  // namespace kdray::core
