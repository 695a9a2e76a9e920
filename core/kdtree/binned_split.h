// Cuts at evenly spaced planes: what a large node can afford.
#pragma once

#include <optional>
#include <span>

#include "core/kdtree/partition.h"
#include "core/kdtree/split.h"

namespace kdray::core {

/// The cheapest of the cuts at the 33 faces of 32 equal bins across the references' bounds, on each
/// axis; nothing when a leaf is cheaper. Counts are exact, so the outermost two planes cut off
/// exactly the empty space. Large nodes are counted in parallel, with the same result. O(n) time.
/// Source: Shevtsov, Soupikov, Kapustin, "Highly Parallel Fast KD-tree Construction for Interactive
/// Ray Tracing of Dynamic Scenes", 2007 (min-max binning).
std::optional<SplitCandidate> FindBinnedSplit(std::span<const Reference> references,
                                              const Bounds3f& cell, const SahCost& cost);

}  // namespace kdray::core
