// SPDX-License-Identifier: Apache-2.0
// Sorts similar rays together, so a ray finds the data of its predecessors in the caches.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/geometry/bounds3.h"
#include "core/geometry/ray.h"

namespace kdray::core {

/// Whether the rays are unordered: in a sample, fewer than half of the neighbours begin close to
/// each other (1/16 of the bounds), or at one point in nearly the same direction (11 degrees).
/// `bounds` in the rays' units.
bool IsShuffled(const RayBatch& rays, const Bounds3d& bounds);

/// Rays that are sorted together; more make neighbours more similar.
inline constexpr std::size_t kSortedRays = std::size_t{1} << 17;

/// Estimates the number of groups of the rays; a group begins in one cell (of 16 x 16 x 16) and has
/// one octant. Computed as the reciprocal of the probability that two rays are in the same group,
/// from a sample of 512; infinity if no two are.
double CountGroups(const RayBatch& rays, const Bounds3d& bounds);

/// Sorts the row numbers first .. first + out.size() - 1 of the batch by the rays' origins (Morton
/// order of 16 or 32 cells per axis) and directions (octant, and four more bits if `by_direction`).
/// The order is stable. O(n). Source: Aila and Karras, "Architecture Considerations for Tracing
/// Incoherent Rays", 2010 (Morton keys); Bikker 2012 (the value of ordering).
void OrderRays(const RayBatch& rays, const Bounds3d& bounds, bool by_direction, std::size_t first,
               std::span<std::uint32_t> out);

}  // namespace kdray::core
