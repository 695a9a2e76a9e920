// SPDX-License-Identifier: Apache-2.0
#include "core/accel/kdtree/centroid_split.h"

#include <algorithm>

#include "core/base/polled_sort.h"

namespace kdray::core {

namespace {

// What a step of a loop over references or their numbers counts as (CancelPoll).
constexpr std::uint64_t kStepWork = 8;

}  // namespace

void CentroidSplitFinder::CollectCentroids(std::span<const PrimitiveRef> references, int axis) {
  centroids_.clear();
  centroids_.reserve(references.size());
  PolledLoop(references.size(), kStepWork, &poll_, [&](std::size_t i) {
    const PrimitiveId id = references[i].id;
    const double sum = mesh_.LocalCorner(id, 0)[axis] + mesh_.LocalCorner(id, 1)[axis] +
                       mesh_.LocalCorner(id, 2)[axis];
    centroids_.push_back(static_cast<float>(sum / 3));
  });
}

std::optional<SplitCandidate> CentroidSplitFinder::FindMedian(
    std::span<const PrimitiveRef> references, const Bounds3f& cell, int depth) {
  if (references.empty()) return std::nullopt;
  for (int turn = 0; turn < 3; ++turn) {
    const int axis = (depth + turn) % 3;
    CollectCentroids(references, axis);
    if (poll_.stopped()) return std::nullopt;
    const std::size_t middle = centroids_.size() / 2;
    if (!PolledNthElement(std::span(centroids_), middle, kStepWork, &poll_)) return std::nullopt;
    float median = centroids_[middle];
    if (centroids_.size() % 2 == 0) {
      float before = centroids_[0];
      PolledLoop(middle, 1, &poll_,
                 [&](std::size_t i) { before = std::max(before, centroids_[i]); });
      median = before * 0.5f + median * 0.5f;
    }

    SplitCandidate split;
    split.plane = {axis, median};
    if (!split.plane.IsInside(cell)) continue;
    PolledLoop(ReferenceChunks(references.size()), kReferenceChunk, &poll_, [&](std::size_t i) {
      const std::size_t first = i * kReferenceChunk;
      const SideCounts counts = CountSides(
          references.subspan(first, std::min(kReferenceChunk, references.size() - first)), split);
      split.below += counts.below;
      split.above += counts.above;
    });
    if (poll_.stopped()) return std::nullopt;
    if (split.below < references.size() && split.above < references.size()) return split;
  }
  return std::nullopt;
}

std::optional<SplitCandidate> CentroidSplitFinder::FindCyclic(
    std::span<const PrimitiveRef> references, const Bounds3f& cell, int depth) {
  for (int turn = 0; turn < 3; ++turn) {
    const int axis = (depth + turn) % 3;
    CollectCentroids(references, axis);
    for (std::vector<float>* v : {&lows_, &highs_, &planars_}) {
      v->clear();
      v->reserve(references.size());
    }
    PolledLoop(references.size(), kStepWork, &poll_, [&](std::size_t i) {
      const float low = references[i].bounds.min[axis];
      const float high = references[i].bounds.max[axis];
      lows_.push_back(low);
      highs_.push_back(high);
      if (low == high) planars_.push_back(low);
    });
    for (std::vector<float>* v : {&centroids_, &lows_, &highs_, &planars_}) {
      if (!PolledSort(std::span(*v), kStepWork, &poll_)) return std::nullopt;
    }

    SplitSearch search(cost_, cell, references.size());
    SplitSearch::Axis candidates(&search, axis);
    std::size_t below = 0;       // lower end < plane
    std::size_t ended = 0;       // upper end <= plane
    std::size_t planar_end = 0;  // planar ones at or below the plane
    for (std::size_t i = 0; i < centroids_.size(); ++i) {
      if (poll_.Spend(kStepWork)) return std::nullopt;
      const float plane = centroids_[i];
      if (i > 0 && plane == centroids_[i - 1]) continue;
      while (below < lows_.size() && lows_[below] < plane) ++below;
      while (ended < highs_.size() && highs_[ended] <= plane) ++ended;
      while (planar_end < planars_.size() && planars_[planar_end] < plane) ++planar_end;
      const std::size_t planar_begin = planar_end;
      while (planar_end < planars_.size() && planars_[planar_end] == plane) ++planar_end;
      candidates.Consider(plane, below, planar_end - planar_begin, references.size() - ended);
    }
    if (search.best()) return search.best();
  }
  return std::nullopt;
}

}  // namespace kdray::core
