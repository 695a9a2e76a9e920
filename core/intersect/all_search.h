// SPDX-License-Identifier: Apache-2.0
// The search of one ray for all its hits, templated over the triangle intersection and the
// structure: the plain form of what the kernels (core/kernel) do for `count` and `all`.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "core/base/cancel_poll.h"
#include "core/base/polled_sort.h"
#include "core/geometry/hit.h"
#include "core/geometry/local_ray.h"
#include "core/intersect/closest_search.h"
#include "core/intersect/hit_filter.h"

namespace kdray::core {

/// A triangle that the ray hits, with what its intersection test knows of it.
template <class Test>
struct FoundHit {
  typename Test::Hit hit;
  PrimitiveId id;
};
/// Work (CancelPoll) of moving a found hit in a sort.
inline constexpr std::uint64_t kFoundWork = 16;

/// The triangles that a ray hits within the caller's interval and that the filter keeps, each once,
/// by id: in `exact` those that the moved ray crosses (ExactIntersection::OwnsCrossing), in the
/// other precisions all that the test accepts. Unspecified if the poll stops. `found` is emptied
/// first.
template <class Test, class Structure, class Corners>
void FindAll(const Structure& structure, const Corners& corners, const LocalRay& ray,
             const Test& test, const HitFilter* filter, CancelPoll* poll,
             std::vector<FoundHit<Test>>* found) {
  const RayFilter keeps{filter, ray.given};
  found->clear();
  structure.Traverse(
      ray, test.pad(),
      [&](std::span<const PrimitiveId> leaf) {
        for (const PrimitiveId id : leaf) {
          if (poll->Spend(Test::kWork)) return -std::numeric_limits<double>::infinity();
          const auto [a, b, c] = corners(id);
          typename Test::Hit hit;
          if (test.Test(a, b, c, &hit) && test.OwnsCrossing(a, b, c, hit) &&
              test.IsInInterval(hit, id, corners) && keeps.Keeps(id)) {
            found->push_back({hit, id});
          }
        }
        return std::numeric_limits<double>::infinity();
      },
      [&] { return !poll->Spend(kNodeWork); });
  // A kd-tree may have a triangle in several leaves.
  PolledSort(std::span(*found), kFoundWork, poll,
             [](const auto& a, const auto& b) { return a.id < b.id; });
  found->erase(std::unique(found->begin(), found->end(),
                           [](const auto& a, const auto& b) { return a.id == b.id; }),
               found->end());
}

/// Appends the nearest `max_hits` of them to `hits`, in order.
template <class Test, class Corners>
void FinishNearest(const Test& test, const Corners& corners, std::size_t max_hits, CancelPoll* poll,
                   std::span<FoundHit<Test>> found, std::vector<Hit>* hits) {
  const std::size_t kept = std::min(max_hits, found.size());
  PolledPartialSort(found, kept, Test::kWork, poll, [&](const auto& a, const auto& b) {
    return test.IsCloser(a.hit, a.id, b.hit, b.id, corners);
  });
  for (const FoundHit<Test>& f : found.first(kept)) {
    hits->push_back(test.Finish(f.hit, f.id, corners));
  }
}

}  // namespace kdray::core
