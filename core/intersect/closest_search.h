// SPDX-License-Identifier: Apache-2.0
// The search of one ray for its closest hit, templated over the triangle intersection and the
// structure: the plain form of the kernels (core/kernel).
#pragma once

#include <array>
#include <limits>
#include <span>

#include "core/base/cancel_poll.h"
#include "core/geometry/hit.h"
#include "core/geometry/local_ray.h"
#include "core/geometry/triangle_mesh.h"
#include "core/intersect/exact_intersection.h"
#include "core/intersect/hit_filter.h"
#include "core/intersect/precision.h"
#include "core/intersect/triangle_intersection.h"

namespace kdray::core {

/// The triangles of a mesh in the number type of a triangle intersection.
template <class Number, class Stored>
class Corners {
 public:
  Corners(std::span<const Vec3<Stored>> vertices, std::span<const TriangleIndices> triangles)
      : vertices_(vertices), triangles_(triangles) {}

  std::array<Vec3<Number>, 3> operator()(PrimitiveId id) const {
    const TriangleIndices& t = triangles_[id];
    return {Vec3<Number>(vertices_[t[0]]), Vec3<Number>(vertices_[t[1]]),
            Vec3<Number>(vertices_[t[2]])};
  }

 private:
  std::span<const Vec3<Stored>> vertices_;
  std::span<const TriangleIndices> triangles_;
};

/// Returns f(corners, IntersectionTag<Test>()) for the test of a precision and the mesh's corners
/// in its number type. The only place where a precision becomes a test.
template <class Test>
struct IntersectionTag {
  using Type = Test;
};
template <class F>
decltype(auto) VisitIntersection(const TriangleMesh& mesh, Precision precision, const F& f) {
  return mesh.VisitVertices(
      [&]<class Stored>(std::span<const Vec3<Stored>> vertices) -> decltype(auto) {
        const auto with = [&]<class Test>(IntersectionTag<Test> tag) -> decltype(auto) {
          return f(Corners<typename Test::Number, Stored>(vertices, mesh.triangles()), tag);
        };
        switch (precision) {
          case Precision::kFast:
            return with(IntersectionTag<FastIntersection>());
          case Precision::kWatertight:
            return with(IntersectionTag<WatertightIntersection<float>>());
          case Precision::kDouble:
            return with(IntersectionTag<WatertightIntersection<double>>());
          case Precision::kExact:
            break;
        }
        return with(IntersectionTag<ExactIntersection>());
      });
}

/// Counts nothing.
struct NoCost {
  void CountNode() {}
  void CountTriangles(std::size_t) {}
};

/// One ray's search for the closest accepted triangle within the caller's interval that the filter
/// keeps.
template <class Test>
struct ClosestSearch {
  RayFilter filter;
  typename Test::Hit best{};
  PrimitiveId best_id = kNoPrimitive;
  /// The local parameter beyond which no triangle can be closer.
  double limit = std::numeric_limits<double>::infinity();

  /// Returns whether the triangle was kept.
  template <class Corners>
  bool Offer(const Test& test, PrimitiveId id, const Corners& corners) {
    if (id == best_id) return false;  // seen already in another leaf
    const auto [a, b, c] = corners(id);
    typename Test::Hit hit;
    if (!test.Test(a, b, c, &hit)) return false;
    if (best_id != kNoPrimitive && !test.IsCloser(hit, id, best, best_id, corners)) return false;
    if (!test.IsInInterval(hit, id, corners) || !filter.Keeps(id)) return false;
    best = hit;
    best_id = id;
    limit = test.Limit(hit);
    return true;
  }
  template <class Corners>
  Hit Finish(const Test& test, const Corners& corners) const {
    return best_id == kNoPrimitive ? Hit{} : test.Finish(best, best_id, corners);
  }
};

/// Work (CancelPoll) of one ray's step through a node of a structure.
inline constexpr std::uint64_t kNodeWork = 32;

/// The closest accepted triangle; Hit{} on a miss; unspecified if the poll stops.
template <class Test, class Structure, class Corners, class Cost>
Hit FindClosest(const Structure& structure, const Corners& corners, const LocalRay& ray,
                const HitFilter* filter, Cost cost, CancelPoll* poll) {
  const Test test(ray);
  ClosestSearch<Test> closest{.filter = {filter, ray.given}};
  structure.Traverse(
      ray, test.pad(),
      [&](std::span<const PrimitiveId> leaf) {
        cost.CountTriangles(leaf.size());
        for (const PrimitiveId id : leaf) {
          if (poll->Spend(Test::kWork)) return -std::numeric_limits<double>::infinity();
          closest.Offer(test, id, corners);
        }
        return closest.limit;
      },
      [&] {
        cost.CountNode();
        return !poll->Spend(kNodeWork);
      });
  return closest.Finish(test, corners);
}

}  // namespace kdray::core
