#include "core/trace/brute_force.h"

#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "core/geometry/local_ray.h"
#include "core/trace/exact_test.h"
#include "core/trace/query.h"

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

template <class Test>
Hit Closest(const TriangleMesh& mesh, const Ray& given) {
  const std::optional<LocalRay> local = Test::MakeRay(given, mesh.frame());
  if (!local) return Hit{};
  std::vector<PrimitiveId> ids;
  for (PrimitiveId id = 0; id < mesh.triangle_count(); ++id) {
    if (!mesh.IsDegenerate(id)) ids.push_back(id);
  }
  return mesh.VisitVertices([&]<class Stored>(std::span<const Vec3<Stored>> vertices) {
    CancelPoll never{CancelToken()};
    return FindClosest<Test>(EveryTriangle{ids},
                             Corners<typename Test::Number, Stored>(vertices, mesh.triangles()),
                             *local, NoCost{}, &never);
  });
}

}  // namespace

Hit BruteForceClosest(const TriangleMesh& mesh, const Ray& ray, Precision precision) {
  if (!IsValid(ray)) {
    Hit invalid;
    invalid.t = std::numeric_limits<double>::quiet_NaN();
    return invalid;
  }
  switch (precision) {
    case Precision::kFast:
      return Closest<FastTest>(mesh, ray);
    case Precision::kWatertight:
      return Closest<WatertightTest<float>>(mesh, ray);
    case Precision::kDouble:
      return Closest<WatertightTest<double>>(mesh, ray);
    case Precision::kExact:
      return Closest<ExactTest>(mesh, ray);
  }
  return Hit{};
}

bool BruteForceAny(const TriangleMesh& mesh, const Ray& ray, Precision precision) {
  return BruteForceClosest(mesh, ray, precision).IsHit();
}

}  // namespace kdray::core
