// SPDX-License-Identifier: Apache-2.0
#include "core/proximity/sides.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <vector>

#include "core/geometry/mesh_health.h"
#include "tests/support/cancel_probe.h"
#include "tests/support/rationals.h"
#include "tests/support/scenes.h"
#include "tests/support/seed.h"
#include "tests/support/shapes.h"

namespace kdray::core {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

Scene SceneOf(const MeshData& data, BuildKind build = BuildKind::kKdSah) {
  Scene scene = test::MakeScene(data, build);
  scene.is_closed = CheckHealth(*scene.mesh, data).value().closed;
  return scene;
}

std::vector<Side> Sides(const Scene& scene, const std::vector<Vec3d>& points) {
  std::vector<Side> sides(points.size());
  EXPECT_TRUE(FindSides(scene, points, {}, sides).ok());
  return sides;
}
std::vector<double> Distances(const Scene& scene, const std::vector<Vec3d>& points,
                              PointPrecision precision = PointPrecision::kDouble) {
  std::vector<double> distances(points.size());
  EXPECT_TRUE(
      FindSignedDistances(scene, points, {.precision = precision, .cancel = {}}, distances).ok());
  return distances;
}

std::vector<Vec3d> PointsIn(const Vec3d& center, double half_edge, std::size_t count,
                            std::mt19937_64& engine) {
  std::uniform_real_distribution<double> uniform(-half_edge, half_edge);
  std::vector<Vec3d> points;
  for (std::size_t i = 0; i < count; ++i) {
    const double x = uniform(engine), y = uniform(engine);
    points.push_back(center + Vec3d{x, y, uniform(engine)});
  }
  return points;
}

MeshData InsideOut(MeshData data) {
  for (TriangleIndices& t : data.triangles) std::swap(t[1], t[2]);
  return data;
}

TEST(Sides, OfACubeAreThoseOfItsInequalities) {
  auto engine = test::RandomEngine(3200);
  for (const Vec3d& center : {Vec3d{0, 0, 0}, Vec3d{1e6, -2e6, 3e6}}) {
    for (const bool inside_out : {false, true}) {
      const MeshData cube = test::Cube(center, 1);
      const Scene scene = SceneOf(inside_out ? InsideOut(cube) : cube);
      ASSERT_TRUE(scene.is_closed);
      const std::vector<Vec3d> points = PointsIn(center, 2, 2000, engine);
      const std::vector<Side> sides = Sides(scene, points);
      const std::vector<double> distances = Distances(scene, points);
      for (std::size_t i = 0; i < points.size(); ++i) {
        const bool inside = MaxAbs(points[i] - center) <= 1;
        ASSERT_EQ(sides[i], inside ? Side::kInside : Side::kOutside) << "point " << i;
        ASSERT_EQ(distances[i] < 0, inside) << "point " << i;
        if (inside) {
          ASSERT_NEAR(distances[i], MaxAbs(points[i] - center) - 1, 1e-9);
        }
      }
    }
  }
}

// The polyhedra are within a twentieth of their spheres; points there are left out.
TEST(Sides, OfNestedShellsAlternate) {
  auto engine = test::RandomEngine(3201);
  MeshData shells = test::IcoSphere({0, 0, 0}, 1, 3);
  for (const double radius : {2.0, 3.0, 4.0}) {
    const MeshData shell = test::IcoSphere({0, 0, 0}, radius, 3);
    shells = test::Join(shells, radius == 3 ? InsideOut(shell) : shell);
  }
  const Scene scene = SceneOf(shells);
  ASSERT_TRUE(scene.is_closed);
  std::size_t seen[2] = {};
  for (const Vec3d& p : PointsIn({0, 0, 0}, 4.5, 3000, engine)) {
    const double radius = Length(p);
    if (radius - std::floor(radius) > 0.95 || radius == std::floor(radius)) continue;
    const auto within = static_cast<int>(std::floor(radius));  // shells that do not contain it
    const bool inside = within < 4 && within % 2 == 1;
    ASSERT_EQ(Sides(scene, {p})[0], inside ? Side::kInside : Side::kOutside) << radius;
    ++seen[inside];
  }
  EXPECT_GT(seen[0], 200u);
  EXPECT_GT(seen[1], 200u);
}

TEST(Sides, OnTheSurfaceAreInsideAtDistanceZero) {
  // Coordinates with few bits, so points of faces and edges are exact.
  const MeshData lattice =
      test::Join(test::Cube({2, 2, 2}, 1), InsideOut(test::Cube({10, 2, 2}, 2)));
  MeshData tetrahedron;
  tetrahedron.vertices = {{0, 0, 0}, {8, 0, 0}, {0, 8, 0}, {0, 0, 8}};
  tetrahedron.triangles = {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}};
  MeshData open = tetrahedron;
  open.triangles.pop_back();
  for (const MeshData& data : {lattice, tetrahedron, open, test::Grid(4, 1, 0.5)}) {
    const Scene scene = SceneOf(data);
    std::vector<Vec3d> points;
    for (PrimitiveId id = 0; id < data.triangles.size(); ++id) {
      const auto [a, b, c] = test::CornersOf(data, id);
      points.insert(points.end(),
                    {a, b, (a + b) * 0.5, a * 0.25 + c * 0.75, a * 0.5 + b * 0.25 + c * 0.25});
    }
    for (const Side side : Sides(scene, points)) ASSERT_EQ(side, Side::kInside);
    for (const PointPrecision precision : {PointPrecision::kDouble, PointPrecision::kExact}) {
      for (const double distance : Distances(scene, points, precision)) {
        ASSERT_EQ(distance, 0);
        ASSERT_FALSE(std::signbit(distance));
      }
    }
  }
}

// An ulp above and below an oblique face, where rounded planes fail.
TEST(Sides, AreExactNextToTheSurface) {
  const MeshData data = test::IcoSphere({0.1, 0.2, 0.3}, 1, 2);
  const Scene scene = SceneOf(data);
  auto engine = test::RandomEngine(3202);
  std::uniform_real_distribution<double> uniform(0, 0.5);
  std::vector<Vec3d> points;
  for (int i = 0; i < 50; ++i) {
    const auto id = static_cast<PrimitiveId>(engine() % data.triangles.size());
    const auto [a, b, c] = test::CornersOf(data, id);
    const double u = uniform(engine), v = uniform(engine);
    Vec3d p = a * (1 - u - v) + b * u + c * v;
    p.x = std::nextafter(p.x, i % 2 == 0 ? 10.0 : -10.0);
    points.push_back(p);
  }
  const std::vector<Side> sides = Sides(scene, points);
  for (std::size_t i = 0; i < points.size(); ++i) {
    // Of all planes, in rational numbers: the sphere is convex.
    int outside = 0;
    for (PrimitiveId id = 0; id < data.triangles.size(); ++id) {
      const auto [a, b, c] = test::CornersOf(data, id);
      const auto exact = [&](int axis, const Vec3d& from, const Vec3d& to) {
        return mpq_class(mpq_class(to[axis]) - mpq_class(from[axis]));
      };
      const auto cross = [&](int k) {
        const int m = (k + 1) % 3, n = (k + 2) % 3;
        return mpq_class(exact(m, a, b) * exact(n, a, c) - exact(n, a, b) * exact(m, a, c));
      };
      mpq_class height = 0;
      for (int axis = 0; axis < 3; ++axis) height += cross(axis) * exact(axis, a, points[i]);
      outside += height > 0;
    }
    ASSERT_EQ(sides[i], outside == 0 ? Side::kInside : Side::kOutside) << "point " << i;
  }
}

TEST(Sides, OfAnOpenMeshAreUnknownExceptWhereAllDirectionsAgree) {
  // A box without its top.
  MeshData box = test::Cube({0, 0, 0}, 1);
  std::erase_if(box.triangles, [&](const TriangleIndices& t) {
    return box.vertices[t[0]].z > 0 && box.vertices[t[1]].z > 0 && box.vertices[t[2]].z > 0;
  });
  ASSERT_EQ(box.triangles.size(), 10u);
  const Scene scene = SceneOf(box);
  ASSERT_FALSE(scene.is_closed);
  auto engine = test::RandomEngine(3203);
  std::size_t unknown = 0, inside = 0;
  const std::vector<Vec3d> points = PointsIn({0, 0, 0}, 1.5, 2000, engine);
  const std::vector<Side> sides = Sides(scene, points);
  const std::vector<double> distances = Distances(scene, points);
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (!scene.mesh->bounds().Contains(points[i])) {
      ASSERT_EQ(sides[i], Side::kOutside);
      ASSERT_GT(distances[i], 0);
      continue;
    }
    unknown += sides[i] == Side::kUnknown;
    inside += sides[i] == Side::kInside;
    ASSERT_EQ(std::isnan(distances[i]), sides[i] == Side::kUnknown);
    // One of the directions points down, where the box is closed.
    ASSERT_NE(sides[i], Side::kOutside);
  }
  EXPECT_GT(unknown, 50u);
  EXPECT_GT(inside, 50u);
}

TEST(Sides, AreTheSameForEveryBuild) {
  auto engine = test::RandomEngine(3204);
  const MeshData data = test::Join(test::BumpySphere({0, 0, 0}, 1, 10, 14, 0.3),
                                   test::BumpySphere({0.5, 0.2, 0}, 1, 10, 14, 0.2));
  std::vector<Vec3d> points = PointsIn({0, 0, 0}, 1.6, 1000, engine);
  points.insert(points.end(), data.vertices.begin(), data.vertices.end());
  const Scene first = SceneOf(data, BuildKind::kBox);
  for (const BuildKind build : kAllBuildKinds) {
    const Scene scene = SceneOf(data, build);
    ASSERT_EQ(Sides(scene, points), Sides(first, points)) << Name(build);
    ASSERT_EQ(Distances(scene, points), Distances(first, points)) << Name(build);
  }
}

TEST(Sides, OfInvalidPointsAreUnknown) {
  const Scene scene = SceneOf(test::Cube({0, 0, 0}, 1));
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  const std::vector<Vec3d> points = {{kNan, 0, 0}, {0, kInfinity, 0}, {0, 0, 0}, {1e300, 0, 0}};
  EXPECT_EQ(Sides(scene, points),
            (std::vector{Side::kUnknown, Side::kUnknown, Side::kInside, Side::kOutside}));
  const std::vector<double> distances = Distances(scene, points);
  EXPECT_TRUE(std::isnan(distances[0]) && std::isnan(distances[1]));
  EXPECT_EQ(distances[2], -1);
  EXPECT_EQ(distances[3], 1e300);
  EXPECT_TRUE(Sides(scene, {}).empty());
}

TEST(Sides, StopSoonAfterTheyAreCancelled) {
  const MeshData data = test::IcoSphere({0, 0, 0}, 1, 6);
  const Scene scene = SceneOf(data);
  auto engine = test::RandomEngine(3205);
  const std::vector<Vec3d> points = PointsIn({0, 0, 0}, 0.9, 3'000'000, engine);
  std::vector<Side> sides(points.size());
  for (const int after : {5, 100}) {
    const auto call = test::CancelDuring(std::chrono::milliseconds(after), [&](CancelToken token) {
      return FindSides(scene, points, {.cancel = token}, sides);
    });
    test::ExpectPrompt(call, "sides");
  }
}

}  // namespace
}  // namespace kdray::core
