// SPDX-License-Identifier: Apache-2.0
// The two split rules of the lecture note (George Tang, "Acceleration Structures", 2019, section
// 4). Both use the centroids of the triangles and take the axes in turn.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "core/accel/kdtree/partition.h"
#include "core/accel/kdtree/split.h"
#include "core/base/cancel_poll.h"
#include "core/geometry/triangle_mesh.h"

namespace kdray::core {

/// Finds the note's splits; nullopt if `cancel` stops. Keeps scratch memory between calls; for one
/// thread at a time.
class CentroidSplitFinder {
 public:
  CentroidSplitFinder(const TriangleMesh& mesh, const SahCost& cost, const CancelToken& cancel = {})
      : mesh_(mesh), cost_(cost), poll_(cancel) {}

  /// The naive build: the plane at the median of the centroids (between the middle two of an even
  /// number), on axis depth % 3. If that plane is not inside the cell, or one child would get all
  /// triangles, the next axis is tried; nullopt if no axis is left. O(n) time.
  std::optional<SplitCandidate> FindMedian(std::span<const PrimitiveRef> references,
                                           const Bounds3f& cell, int depth);

  /// Algorithm 1: the plane through the centroid that makes the SAH cost least, on axis depth % 3.
  /// If no plane is cheaper than a leaf (a flat mesh has none on one axis), the next axis is tried;
  /// nullopt if no axis is left. The note counts the triangles again for every plane, in O(n^2);
  /// sorted ends give the same counts in O(n log n).
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
