// SPDX-License-Identifier: Apache-2.0
// Closest points and sides in `exact` against CGAL: the squared distance of its AABB tree with an
// exact kernel, and its test for points inside a closed surface.
#include <CGAL/AABB_tree.h>
#include <CGAL/Exact_predicates_exact_constructions_kernel.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Side_of_triangle_mesh.h>
#include <CGAL/Surface_mesh.h>
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
#include <limits>
#include <string>
#include <vector>

#include "core/geometry/mesh_health.h"
#include "core/proximity/closest_points.h"
#include "core/proximity/sides.h"
#include "tests/property/scenes.h"
#include "tests/support/mesh_files.h"
#include "tests/support/seed.h"
#include "tests/support/shapes.h"

namespace kdray::test {
namespace {

using namespace core;

using Kernel = CGAL::Exact_predicates_exact_constructions_kernel;
using Triangles = std::vector<Kernel::Triangle_3>;
#if CGAL_VERSION_MAJOR >= 6  // Debian 13: names with the dimension
using Primitive = CGAL::AABB_triangle_primitive_3<Kernel, Triangles::const_iterator>;
using CgalTree = CGAL::AABB_tree<CGAL::AABB_traits_3<Kernel, Primitive>>;
#else
using Primitive = CGAL::AABB_triangle_primitive<Kernel, Triangles::const_iterator>;
using CgalTree = CGAL::AABB_tree<CGAL::AABB_traits<Kernel, Primitive>>;
#endif
using FastKernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Surface = CGAL::Surface_mesh<FastKernel::Point_3>;

template <class K>
typename K::Point_3 ToPoint(const Vec3d& v) {
  return {v.x, v.y, v.z};
}

/// Whether `root` is the nearest double of the square root, give or take an ulp.
bool IsRootOf(double root, const Kernel::FT& square) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  const Kernel::FT below(std::nextafter(root, 0.0)), above(std::nextafter(root, kInfinity));
  return below * below <= square && square <= above * above;
}

/// In twice the bounds, at vertices, on edges, and next to the surface.
std::vector<Vec3d> Points(const MeshData& data, const Bounds3d& bounds, std::size_t each,
                          std::uint64_t stream) {
  auto engine = RandomEngine(stream);
  const Vec3d half = bounds.Extent() * 0.5;
  std::vector<Vec3d> points;
  for (std::size_t i = 0; i < each; ++i) {
    points.push_back(PointIn({bounds.min - half, bounds.max + half}, engine));
    const TriangleIndices& t = data.triangles[engine() % data.triangles.size()];
    const Vec3d a = data.vertices[t[0]], b = data.vertices[t[1]], c = data.vertices[t[2]];
    points.push_back(a);
    points.push_back(a * 0.5 + b * 0.5);
    points.push_back(a * 0.5 + b * 0.25 + c * 0.25 + half * Uniform(engine, -1e-6, 1e-6));
  }
  return points;
}

void Compare(const std::string& name, const MeshData& data, std::size_t each,
             std::uint64_t stream) {
  SCOPED_TRACE(name);
  Scene scene = MakeScene(data, BuildKind::kKdSah);
  scene.is_closed = CheckHealth(*scene.mesh, data).value().closed;
  ASSERT_TRUE(scene.is_closed);
  const std::vector<Vec3d> points = Points(data, scene.mesh->bounds(), each, stream);
  std::vector<ClosestPoint> closest(points.size());
  std::vector<Side> sides(points.size());
  const PointOptions options{.precision = PointPrecision::kExact, .cancel = {}};
  ASSERT_TRUE(FindClosestPoints(scene, points, options, closest).ok());
  ASSERT_TRUE(FindSides(scene, points, options, sides).ok());

  Triangles triangles;
  Surface surface;
  std::vector<Surface::Vertex_index> vertices;
  for (const Vec3d& v : data.vertices)
    vertices.push_back(surface.add_vertex(ToPoint<FastKernel>(v)));
  for (const TriangleIndices& t : data.triangles) {
    triangles.emplace_back(ToPoint<Kernel>(data.vertices[t[0]]),
                           ToPoint<Kernel>(data.vertices[t[1]]),
                           ToPoint<Kernel>(data.vertices[t[2]]));
    surface.add_face(vertices[t[0]], vertices[t[1]], vertices[t[2]]);
  }
  const CgalTree tree(triangles.cbegin(), triangles.cend());
  const CGAL::Side_of_triangle_mesh<Surface, FastKernel> side_of(surface);
  for (std::size_t i = 0; i < points.size(); ++i) {
    ASSERT_TRUE(IsRootOf(closest[i].distance, tree.squared_distance(ToPoint<Kernel>(points[i]))))
        << "point " << i;
    const bool inside = side_of(ToPoint<FastKernel>(points[i])) != CGAL::ON_UNBOUNDED_SIDE;
    ASSERT_EQ(sides[i], inside ? Side::kInside : Side::kOutside) << "point " << i;
  }
}

TEST(Cgal, HasTheSameDistancesAndSidesOfGeneratedMeshes) {
  Compare("cube", Cube({0, 0, 0}, 1), 200, 4100);
  Compare("sphere", IcoSphere({0.1, 0.2, 0.3}, 1, 3), 200, 4101);
  Compare("sphere far from the origin", UvSphere({448'251, 5'411'932, 122}, 10, 12, 20), 200, 4102);
}

TEST(Cgal, HasTheSameDistancesAndSidesOfAScan) {
  KDRAY_NEED_MESHES();
  Compare("bunny_7k.off", ReadCollectionMesh("bunny_7k.off"), 200, 4103);
}

}  // namespace
}  // namespace kdray::test
