// An order in which rays that are alike follow each other, so that they find in the caches what
// their predecessors fetched.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/geometry/bounds3.h"
#include "core/geometry/ray.h"

namespace kdray::core {

/// Whether the rays come in no order: fewer than half of the neighbours in a sample begin close to
/// each other (1/16 of the bounds), or from one point in nearly one direction (11 degrees).
/// `bounds` in the rays' units.
bool IsShuffled(const RayBatch& rays, const Bounds3d& bounds);

/// So many rays are sorted together: the more, the more alike are neighbours.
inline constexpr std::size_t kSortedRays = std::size_t{1} << 17;

/// In how many groups the rays are: those that begin in one cell (of 16 x 16 x 16) and go into one
/// octant. The reciprocal of how likely two rays are of the same group, estimated from 512 of them;
/// infinity where no two are.
double CountGroups(const RayBatch& rays, const Bounds3d& bounds);

/// The numbers first .. first + out.size() - 1 of the batch, ordered by where the rays begin
/// (Morton order of 16 or 32 cells an axis) and by direction (octant, and four bits more when
/// `by_direction`); in the caller's order where these agree. O(n). Source: Aila and Karras,
/// "Architecture Considerations for Tracing Incoherent Rays", 2010 (Morton keys); Bikker 2012 (what
/// order is worth).
void OrderRays(const RayBatch& rays, const Bounds3d& bounds, bool by_direction, std::size_t first,
               std::span<std::uint32_t> out);

}  // namespace kdray::core
