// The two ways of cutting that the lecture note describes ("Acceleration Structures", section 4).
// Both look at the centroids of the triangles and take the axes in turn.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "core/accel/kdtree/partition.h"
#include "core/accel/kdtree/split.h"
#include "core/base/cancel_poll.h"
#include "core/geometry/triangle_mesh.h"

namespace kdray::core {

/// Finds the note's cuts; nothing once `cancel` says stop. Keeps scratch memory between calls; one
/// thread at a time.
class CentroidSplitFinder {
 public:
  CentroidSplitFinder(const TriangleMesh& mesh, const SahCost& cost, const CancelToken& cancel = {})
      : mesh_(mesh), cost_(cost), poll_(cancel) {}

  /// The naive build: the plane at the median of the centroids (between the middle two of an even
  /// number), on axis depth % 3. Where that plane would not be inside the cell or would leave a
  /// child with everything, the next axis has its turn; nothing when none is left. O(n) time.
  std::optional<SplitCandidate> FindMedian(std::span<const PrimitiveRef> references,
                                           const Bounds3f& cell, int depth);

  /// Algorithm 1: the plane through the centroid that makes the SAH cost least, on axis depth % 3.
  /// Where no plane beats the leaf (a flat mesh has none across), the next axis has its turn;
  /// nothing when none is left. The note counts the triangles anew for every plane, which takes
  /// O(n^2); sorted ends give the same counts in O(n log n).
  std::optional<SplitCandidate> FindCyclic(std::span<const PrimitiveRef> references,
                                           const Bounds3f& cell, int depth);

 private:
  void CollectCentroids(std::span<const PrimitiveRef> references, int axis);

  const TriangleMesh& mesh_;
  const SahCost& cost_;
  CancelPoll poll_;
  std::vector<float> centroids_, lows_, highs_, planars_;
};

}  // namespace kdray::core
