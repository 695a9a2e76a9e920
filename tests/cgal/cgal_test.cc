// SPDX-License-Identifier: Apache-2.0
// The precision `exact` against CGAL's AABB tree with an exact kernel: the same closest triangle,
// and its t, on random and on degenerate rays. CGAL knows nothing of ours: not its frame, filters
// or trees. (Its licence keeps it out of all but tests.)
#include <CGAL/AABB_tree.h>
#include <CGAL/Exact_predicates_exact_constructions_kernel.h>
#include <CGAL/version.h>
#if CGAL_VERSION_MAJOR >= 6
#include <CGAL/AABB_traits_3.h>
#include <CGAL/AABB_triangle_primitive_3.h>
#else
#include <CGAL/AABB_traits.h>
#include <CGAL/AABB_triangle_primitive.h>
#endif
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <limits>
#include <optional>
#include <variant>
#include <vector>

#include "core/trace/brute_force.h"
#include "core/trace/trace.h"
#include "tests/property/closed_meshes.h"
#include "tests/property/scenes.h"
#include "tests/support/mesh_files.h"
#include "tests/support/seed.h"
#include "tests/support/shapes.h"

namespace kdray::test {
namespace {

using namespace core;

using Kernel = CGAL::Exact_predicates_exact_constructions_kernel;
using Triangles = std::vector<Kernel::Triangle_3>;
#if CGAL_VERSION_MAJOR >= 6  // Debian 13: names with the dimension, variants of the standard
using Primitive = CGAL::AABB_triangle_primitive_3<Kernel, Triangles::const_iterator>;
using CgalTree = CGAL::AABB_tree<CGAL::AABB_traits_3<Kernel, Primitive>>;
using std::get_if;
#else
using Primitive = CGAL::AABB_triangle_primitive<Kernel, Triangles::const_iterator>;
using CgalTree = CGAL::AABB_tree<CGAL::AABB_traits<Kernel, Primitive>>;
template <class T, class Variant>
const T* get_if(const Variant* variant) {
  return boost::get<T>(variant);
}
#endif

Kernel::Point_3 ToPoint(const Vec3d& v) { return {v.x, v.y, v.z}; }

class CgalMesh {
 public:
  explicit CgalMesh(const MeshData& data) {
    for (PrimitiveId id = 0; id < data.triangles.size(); ++id) {
      const TriangleIndices& t = data.triangles[id];
      const Kernel::Triangle_3 triangle(ToPoint(data.vertices[t[0]]), ToPoint(data.vertices[t[1]]),
                                        ToPoint(data.vertices[t[2]]));
      if (triangle.is_degenerate()) continue;
      triangles_.push_back(triangle);
      ids_.push_back(id);
    }
    tree_.rebuild(triangles_.cbegin(), triangles_.cend());
  }

  struct Closest {
    Kernel::FT t;
    PrimitiveId primitive_id = kNoPrimitive;
  };
  /// Smallest t, then smallest id. A ray in a triangle's plane does not hit it, so segments that
  /// CGAL finds are left out.
  Closest ClosestHit(const Ray& ray) const {
    const Kernel::Point_3 origin = ToPoint(ray.origin);
    const Kernel::Vector_3 direction(ray.direction.x, ray.direction.y, ray.direction.z);
    std::vector<CgalTree::Intersection_and_primitive_id<Kernel::Ray_3>::Type> found;
    tree_.all_intersections(Kernel::Ray_3(origin, direction), std::back_inserter(found));
    Closest best;
    for (const auto& [place, primitive] : found) {
      const Kernel::Point_3* point = get_if<Kernel::Point_3>(&place);
      if (point == nullptr) continue;
      const Kernel::FT t = ((*point - origin) * direction) / direction.squared_length();
      const PrimitiveId id = ids_[static_cast<std::size_t>(primitive - triangles_.cbegin())];
      if (best.primitive_id == kNoPrimitive || t < best.t ||
          (t == best.t && id < best.primitive_id)) {
        best = {t, id};
      }
    }
    return best;
  }

 private:
  Triangles triangles_;
  std::vector<PrimitiveId> ids_;
  CgalTree tree_;
};

bool IsWithinOneUlp(double rounded, const Kernel::FT& exact) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  return Kernel::FT(std::nextafter(rounded, -kInfinity)) <= exact &&
         exact <= Kernel::FT(std::nextafter(rounded, kInfinity));
}

/// `each` rays of each family.
void Compare(const ClosedMesh& mesh, std::size_t each, std::uint64_t stream) {
  auto engine = RandomEngine(stream);
  std::vector<Ray> rays = RandomRays(mesh.scene.mesh->bounds(), each, engine);
  for (const auto& family : {VertexRays, EdgeRays, AxisRaysThroughVertices, FarRays}) {
    for (const Ray& ray : family(mesh, each, engine)) rays.push_back(ray);
  }
  const CgalMesh cgal(mesh.data);
  std::vector<Hit> hits(rays.size());
  ASSERT_TRUE(
      TraceClosest(mesh.scene, std::span<const Ray>(rays), With(Precision::kExact), hits).ok());
  std::size_t hit = 0, different = 0, wrong_t = 0;
  for (std::size_t i = 0; i < rays.size(); ++i) {
    const CgalMesh::Closest want = cgal.ClosestHit(rays[i]);
    if (hits[i].primitive_id != want.primitive_id) {
      ++different;
      ADD_FAILURE() << mesh.name << ", ray " << i << ": triangle " << hits[i].primitive_id
                    << ", CGAL's " << want.primitive_id;
    } else if (hits[i].IsHit()) {
      ++hit;
      wrong_t += IsWithinOneUlp(hits[i].t, want.t) ? 0 : 1;
    }
  }
  EXPECT_EQ(wrong_t, 0u) << mesh.name;
  EXPECT_GT(hit, rays.size() / 2);
  std::printf("%s: %zu rays, %zu hits; %zu other triangles than CGAL's, %zu times another t\n",
              mesh.name.c_str(), rays.size(), hit, different, wrong_t);
}

std::size_t RaysOfAFamily() { return static_cast<std::size_t>(400 * RaysFactor()); }

TEST(Cgal, HasTheSameClosestHitsOnGeneratedMeshes) {
  Compare(MakeClosedMesh("cube", Cube({0, 0, 0}, 1)), RaysOfAFamily(), 4001);
  Compare(MakeClosedMesh("sphere", IcoSphere({0.1, 0.2, 0.3}, 1, 3)), RaysOfAFamily(), 4002);
  Compare(
      MakeClosedMesh("sphere far from the origin", UvSphere({448'251, 5'411'932, 122}, 10, 12, 20)),
      RaysOfAFamily(), 4003);
}

TEST(Cgal, HasTheSameClosestHitsOnAScan) {
  KDRAY_NEED_MESHES();
  Compare(MakeClosedMesh("bunny_7k.off", ReadCollectionMesh("bunny_7k.off")), RaysOfAFamily(),
          4004);
}

// The oracle itself, without a tree.
TEST(Cgal, AgreesWithBruteForceInExact) {
  auto engine = RandomEngine(4005);
  const MeshData data = Join(Soup(60, 0.6, 4006), Cube({0.5, 0.5, 0.5}, 0.25));
  const TriangleMesh mesh = TriangleMesh::Create(data).value();
  const CgalMesh cgal(data);
  std::vector<Ray> rays = RandomRays(mesh.bounds(), 600, engine);
  for (const Ray& ray : RaysAtVertices(data, PointIn(mesh.bounds(), engine), 600))
    rays.push_back(ray);
  for (const Ray& ray : RaysOnEdges(data, {0.5, 0.5, 0.5}, 600, engine)) rays.push_back(ray);
  for (const Ray& ray : rays) {
    const Hit hit = BruteForceClosest(mesh, ray, Precision::kExact);
    const CgalMesh::Closest want = cgal.ClosestHit(ray);
    ASSERT_EQ(hit.primitive_id, want.primitive_id);
    if (hit.IsHit()) {
      ASSERT_TRUE(IsWithinOneUlp(hit.t, want.t));
    }
  }
}

}  // namespace
}  // namespace kdray::test
