// Cuts at evenly spaced planes: what a large node can afford.
#pragma once

#include <optional>
#include <span>

#include "core/kdtree/partition.h"
#include "core/kdtree/split.h"

namespace kdray::core {

/// The cheapest of the cuts at evenly spaced planes, on each axis, and of those at the faces of
/// `bounds`, which cut off exactly the empty space; nothing when a leaf is cheaper. The planes lie
/// at the multiples of a power of two, which makes from 16 to 32 bins of an axis. (Fewer where the
/// bounds are a few floats wide.) `bounds` is the union of the references'; counts are exact. Large
/// nodes are counted in parallel, with the same result. O(n) time. Source: Shevtsov, Soupikov,
/// Kapustin, "Highly Parallel Fast KD-tree Construction for Interactive Ray Tracing of Dynamic
/// Scenes", 2007 (min-max binning).
std::optional<SplitCandidate> FindBinnedSplit(std::span<const Reference> references,
                                              const Bounds3f& bounds, const Bounds3f& cell,
                                              const SahCost& cost);

}  // namespace kdray::core
