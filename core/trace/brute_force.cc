#include "core/trace/brute_force.h"

#include <limits>
#include <optional>

#include "core/geometry/local_ray.h"
#include "core/trace/leaf_test.h"

namespace kdray::core {
namespace {

template <class Test>
Hit Closest(const TriangleMesh& mesh, const LocalRay& ray) {
  const Test test(ray);
  Hit best;
  double best_shifted = std::numeric_limits<double>::infinity();
  using Number = typename Test::Number;
  for (PrimitiveId id = 0; id < mesh.triangle_count(); ++id) {
    if (mesh.IsDegenerate(id)) continue;
    LeafHit hit;
    if (!test.Test(Vec3<Number>(mesh.LocalCorner(id, 0)), Vec3<Number>(mesh.LocalCorner(id, 1)),
                   Vec3<Number>(mesh.LocalCorner(id, 2)), &hit)) {
      continue;
    }
    const double t = ray.ToCallerT(hit.s);
    if (!(t >= ray.t_min && t <= ray.t_max)) continue;
    const double shifted = hit.s + ray.shift;
    if (Closer(shifted, id, best_shifted, best.primitive_id)) {
      best = {t, hit.u, hit.v, id};
      best_shifted = shifted;
    }
  }
  return best;
}

}  // namespace

Hit BruteForceClosest(const TriangleMesh& mesh, const Ray& ray, Precision precision) {
  if (!IsValid(ray)) {
    Hit invalid;
    invalid.t = std::numeric_limits<double>::quiet_NaN();
    return invalid;
  }
  const std::optional<LocalRay> local = MakeLocalRay(ray, mesh.frame());
  if (!local) return Hit{};
  switch (precision) {
    case Precision::kFast:
      return Closest<FastTest>(mesh, *local);
    case Precision::kWatertight:
      return Closest<WatertightTest<float>>(mesh, *local);
    case Precision::kDouble:
      return Closest<WatertightTest<double>>(mesh, *local);
  }
  return Hit{};
}

bool BruteForceAny(const TriangleMesh& mesh, const Ray& ray, Precision precision) {
  return BruteForceClosest(mesh, ray, precision).IsHit();
}

}  // namespace kdray::core
