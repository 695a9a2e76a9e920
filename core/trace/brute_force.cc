// SPDX-License-Identifier: Apache-2.0
#include "core/trace/brute_force.h"

#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "core/geometry/local_ray.h"
#include "core/intersect/all_search.h"
#include "core/intersect/closest_search.h"

namespace kdray::core {
namespace {

/// The whole mesh as one leaf, without even a bounding box.
struct EveryTriangle {
  std::span<const PrimitiveId> ids;

  template <class Visit, class OnNode>
  void Traverse(const LocalRay&, double, const Visit& visit, const OnNode&) const {
    visit(ids);
  }
};

EveryTriangle TrianglesOf(const TriangleMesh& mesh, std::vector<PrimitiveId>* ids) {
  for (PrimitiveId id = 0; id < mesh.triangle_count(); ++id) {
    if (!mesh.IsDegenerate(id)) ids->push_back(id);
  }
  return {*ids};
}

}  // namespace

Hit BruteForceClosest(const TriangleMesh& mesh, const Ray& ray, Precision precision,
                      const HitFilter::Options& filter) {
  if (!IsValid(ray)) {
    Hit invalid;
    invalid.t = std::numeric_limits<double>::quiet_NaN();
    return invalid;
  }
  std::vector<PrimitiveId> ids;
  const EveryTriangle triangles = TrianglesOf(mesh, &ids);
  const HitFilter keeps(mesh, filter);
  return VisitIntersection(
      mesh, precision, [&]<class Test>(const auto& corners, IntersectionTag<Test>) {
        const std::optional<LocalRay> local = Test::MakeRay(ray, mesh.frame());
        CancelPoll never{CancelToken()};
        return local ? FindClosest<Test>(triangles, corners, *local, &keeps, NoCost{}, &never)
                     : Hit{};
      });
}

bool BruteForceAny(const TriangleMesh& mesh, const Ray& ray, Precision precision,
                   const HitFilter::Options& filter) {
  return BruteForceClosest(mesh, ray, precision, filter).IsHit();
}

std::vector<Hit> BruteForceAll(const TriangleMesh& mesh, const Ray& ray, Precision precision,
                               const HitFilter::Options& filter) {
  std::vector<Hit> hits;
  if (!IsValid(ray)) return hits;
  std::vector<PrimitiveId> ids;
  const EveryTriangle triangles = TrianglesOf(mesh, &ids);
  const HitFilter keeps(mesh, filter);
  VisitIntersection(mesh, precision, [&]<class Test>(const auto& corners, IntersectionTag<Test>) {
    const std::optional<LocalRay> local = Test::MakeRay(ray, mesh.frame());
    if (!local) return;
    CancelPoll never{CancelToken()};
    const Test test(*local);
    std::vector<FoundHit<Test>> found;
    FindAll(triangles, corners, *local, test, &keeps, &never, &found);
    FinishNearest(test, corners, found.size(), &never, std::span(found), &hits);
  });
  return hits;
}

}  // namespace kdray::core
