#include "core/trace/brute_force.h"

#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "core/geometry/local_ray.h"
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

}  // namespace

Hit BruteForceClosest(const TriangleMesh& mesh, const Ray& ray, Precision precision) {
  if (!IsValid(ray)) {
    Hit invalid;
    invalid.t = std::numeric_limits<double>::quiet_NaN();
    return invalid;
  }
  std::vector<PrimitiveId> ids;
  for (PrimitiveId id = 0; id < mesh.triangle_count(); ++id) {
    if (!mesh.IsDegenerate(id)) ids.push_back(id);
  }
  return VisitIntersection(
      mesh, precision, [&]<class Test>(const auto& corners, IntersectionTag<Test>) {
        const std::optional<LocalRay> local = Test::MakeRay(ray, mesh.frame());
        CancelPoll never{CancelToken()};
        return local ? FindClosest<Test>(EveryTriangle{ids}, corners, *local, NoCost{}, &never)
                     : Hit{};
      });
}

bool BruteForceAny(const TriangleMesh& mesh, const Ray& ray, Precision precision) {
  return BruteForceClosest(mesh, ray, precision).IsHit();
}

}  // namespace kdray::core
