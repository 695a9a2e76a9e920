// SPDX-License-Identifier: Apache-2.0
#include "core/proximity/closest_points.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "core/base/parallel.h"
#include "core/proximity/point_triangle.h"
#include "tests/support/cancel_probe.h"
#include "tests/support/rationals.h"
#include "tests/support/scenes.h"
#include "tests/support/seed.h"
#include "tests/support/shapes.h"

namespace kdray::core {
namespace {

using test::RationalClosestPoint;

double Uniform(std::mt19937_64& engine, double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(engine);
}

std::vector<ClosestPoint> Find(const Scene& scene, const std::vector<Vec3d>& points,
                               const PointOptions& options) {
  std::vector<ClosestPoint> answers(points.size());
  EXPECT_TRUE(FindClosestPoints(scene, points, options, answers).ok());
  return answers;
}

/// Points in twice the bounds, on and near the surface, at corners, on edges, and `far` sizes away.
std::vector<Vec3d> PointsAround(const MeshData& data, std::size_t each, std::mt19937_64& engine,
                                const std::vector<double>& far = {10, 1e3, 1e6, 1e10, 1e20}) {
  Bounds3d bounds = Bounds3d::Empty();
  for (const Vec3d& v : data.vertices) bounds.Extend(v);
  const Vec3d center = bounds.Center(), extent = bounds.Extent();
  const double size = MaxAbs(extent);
  const auto anywhere = [&](double scale) {
    Vec3d p;
    for (int axis = 0; axis < 3; ++axis) {
      p[axis] = center[axis] + scale * size * Uniform(engine, -0.5, 0.5);
    }
    return p;
  };
  std::vector<Vec3d> points;
  for (std::size_t i = 0; i < each; ++i) {
    points.push_back(anywhere(2));
    const TriangleIndices& t = data.triangles[engine() % data.triangles.size()];
    const Vec3d a = data.vertices[t[0]], b = data.vertices[t[1]], c = data.vertices[t[2]];
    points.push_back(b);
    points.push_back(a * 0.5 + c * 0.5);
    const double u = Uniform(engine, 0, 0.5), v = Uniform(engine, 0, 0.5);
    const Vec3d on = a * (1 - u - v) + b * u + c * v;
    points.push_back(on);
    points.push_back(on + (anywhere(1) - center) * 1e-3);
    points.push_back(on + (anywhere(1) - center) * 1e-9);
    for (const double distance : far) points.push_back(anywhere(2 * distance));
  }
  return points;
}

struct NamedMesh {
  std::string name;
  MeshData data;
};
std::vector<NamedMesh> Meshes() {
  std::vector<NamedMesh> meshes = {
      {"cube", test::Cube({0, 0, 0}, 1)},
      {"sphere", test::IcoSphere({0.1, 0.2, 0.3}, 1, 1)},
      {"float sphere", test::RoundToFloat(test::UvSphere({3, 1, -2}, 1, 5, 7))},
      {"sphere far from the origin", test::UvSphere({448'251, 5'411'932, 122}, 10, 5, 7)},
      {"soup", test::Soup(60, 0.3, 3100)},
      {"coincident triangles", test::Coincident(20)},
      {"comb of needles", test::Comb(8)},
      {"grid", test::Grid(4, 2, 0.25)}};
  // Degenerate triangles between the others; the first of the list would otherwise be closest.
  MeshData degenerate = test::Cube({0, 0, 0}, 1);
  degenerate.triangles.insert(degenerate.triangles.begin(), {0, 0, 1});
  degenerate.vertices.push_back({5, 5, 5});
  degenerate.triangles.push_back({8, 8, 8});
  meshes.push_back({"degenerate triangles", degenerate});
  // Needles 1e-8 thick, and triangles 1e-7 in size beside large ones.
  MeshData slivers;
  auto engine = test::RandomEngine(3101);
  for (std::uint32_t i = 0; i < 40; ++i) {
    const double size = i % 2 == 0 ? 1 : 1e-7, thickness = i % 2 == 0 ? 1e-8 : 1e-7;
    const Vec3d a = {Uniform(engine, -1, 1), Uniform(engine, -1, 1), Uniform(engine, -1, 1)};
    const Vec3d way = {Uniform(engine, -1, 1), Uniform(engine, -1, 1), Uniform(engine, -1, 1)};
    const Vec3d off = {Uniform(engine, -1, 1), Uniform(engine, -1, 1), Uniform(engine, -1, 1)};
    for (const Vec3d& v : {a, a + way * size, a + way * (0.5 * size) + off * thickness}) {
      slivers.vertices.push_back(v);
    }
    slivers.triangles.push_back({3 * i, 3 * i + 1, 3 * i + 2});
  }
  meshes.push_back({"slivers", slivers});
  for (const double scale : {1e-30, 1e30}) {
    MeshData scaled = test::Soup(30, 0.5, 3102);
    for (Vec3d& v : scaled.vertices) v = v * scale;
    meshes.push_back({"scaled by " + std::to_string(scale), scaled});
  }
  return meshes;
}

TEST(ClosestPoints, AreThoseOfRationalNumbersInExact) {
  auto engine = test::RandomEngine(3103);
  for (const NamedMesh& mesh : Meshes()) {
    SCOPED_TRACE(mesh.name);
    const Scene scene = test::MakeScene(mesh.data);
    const std::vector<Vec3d> points = PointsAround(mesh.data, 3, engine);
    const auto answers = Find(scene, points, {.precision = PointPrecision::kExact, .cancel = {}});
    for (std::size_t i = 0; i < points.size(); ++i) {
      const RationalClosestPoint want = test::RationalClosestTo(mesh.data, points[i]);
      ASSERT_EQ(answers[i].primitive_id, want.primitive_id) << "point " << i;
      ASSERT_TRUE(test::IsRoundedRoot(answers[i].distance, want.square))
          << "point " << i << ": " << answers[i].distance;
    }
  }
}

/// |answered - smallest distance| in units of distance + the longest side of the bounds.
double ErrorOf(double answered, const mpq_class& square, double size) {
  mpf_set_default_prec(512);
  const mpf_class exact = sqrt(mpf_class(square, 512));
  const mpf_class error = abs(mpf_class(answered, 512) - exact) / (exact + size);
  return error.get_d();
}

TEST(ClosestPoints, AreWithinTheBoundOfDouble) {
  auto engine = test::RandomEngine(3104);
  double largest = 0;
  for (const NamedMesh& mesh : Meshes()) {
    SCOPED_TRACE(mesh.name);
    const Scene scene = test::MakeScene(mesh.data);
    const double size = MaxAbs(scene.mesh->bounds().Extent());
    const std::vector<Vec3d> points = PointsAround(mesh.data, 5, engine);
    const auto answers = Find(scene, points, {});
    for (std::size_t i = 0; i < points.size(); ++i) {
      const mpq_class square = test::RationalClosestTo(mesh.data, points[i]).square;
      const double error = ErrorOf(answers[i].distance, square, size);
      ASSERT_LE(error, kDistanceBound) << "point " << i;
      // The named triangle is as close.
      const mpq_class named = test::RationalSquaredDistance(
          points[i], test::CornersOf(mesh.data, answers[i].primitive_id));
      ASSERT_LE(ErrorOf(answers[i].distance, named, size), kDistanceBound) << "point " << i;
      largest = std::max(largest, error);
    }
  }
  std::printf("largest error of a distance: 2^%.1f\n", std::log2(largest));
}

TEST(ClosestPoints, AreTheSameForEveryBuildPrecisionOfVerticesAndInstructionSet) {
  auto engine = test::RandomEngine(3105);
  for (const MeshData& data : {test::RoundToFloat(test::BumpySphere({0, 0, 0}, 1, 20, 30, 0.3)),
                               test::Soup(700, 0.1, 3106), test::Coincident(100)}) {
    const std::vector<Vec3d> points = PointsAround(data, 60, engine, {10, 100, 1e9});
    for (const PointPrecision precision : {PointPrecision::kDouble, PointPrecision::kExact}) {
      const auto expected = Find(test::MakeScene(data, BuildKind::kBox), points,
                                 {.precision = precision, .cancel = {}});
      for (const BuildKind build : kAllBuildKinds) {
        const Scene scene = test::MakeScene(data, build);
        for (const SimdLevel simd : SupportedSimdLevels()) {
          const PointOptions options{.precision = precision, .cancel = {}, .simd = simd};
          ASSERT_EQ(Find(scene, points, options), expected) << Name(build) << ", " << Name(simd);
        }
      }
    }
  }
}

// A brute force in the arithmetic that decides.
TEST(ClosestPoints, AreTheSmallestDistanceAndThenTheSmallestNumberOfAllTriangles) {
  auto engine = test::RandomEngine(3107);
  const MeshData data = test::Join(test::IcoSphere({0, 0, 0}, 1, 3), test::Soup(300, 0.2, 3108));
  const Scene scene = test::MakeScene(data);
  const std::vector<Vec3d> points = PointsAround(data, 100, engine, {10});
  const auto answers = Find(scene, points, {});
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Vec3d p = scene.mesh->frame().ToLocal(points[i]);
    double best = std::numeric_limits<double>::infinity();
    PrimitiveId best_id = kNoPrimitive;
    for (PrimitiveId id = 0; id < scene.mesh->triangle_count(); ++id) {
      const double square =
          SquaredDistance(p, scene.mesh->LocalCorner(id, 0), scene.mesh->LocalCorner(id, 1),
                          scene.mesh->LocalCorner(id, 2));
      if (square < best) {
        best = square;
        best_id = id;
      }
    }
    ASSERT_EQ(answers[i].primitive_id, best_id) << "point " << i;
  }
}

TEST(ClosestPoints, DoNotDependOnNeighboursOrThreads) {
  auto engine = test::RandomEngine(3109);
  const MeshData data = test::BumpySphere({0, 0, 0}, 1, 30, 40, 0.3);
  const Scene scene = test::MakeScene(data);
  const std::vector<Vec3d> points = PointsAround(data, 700, engine, {10});
  const auto together = Find(scene, points, {});
  std::vector<ClosestPoint> threaded(points.size());
  Arena(3).Run([&] { ASSERT_TRUE(FindClosestPoints(scene, points, {}, threaded).ok()); });
  EXPECT_EQ(threaded, together);
  for (std::size_t i = 0; i < points.size(); i += 37) {
    ASSERT_EQ(Find(scene, {points[i]}, {})[0], together[i]) << "point " << i;
  }
}

TEST(ClosestPoints, AreOnTheirTriangleWithTheirWeights) {
  auto engine = test::RandomEngine(3110);
  const MeshData data = test::BumpySphere({0, 0, 0}, 1, 8, 12, 0.3);
  const Scene scene = test::MakeScene(data);
  const std::vector<Vec3d> points = PointsAround(data, 50, engine, {10});
  for (const PointPrecision precision : {PointPrecision::kDouble, PointPrecision::kExact}) {
    const auto answers = Find(scene, points, {.precision = precision, .cancel = {}});
    for (std::size_t i = 0; i < points.size(); ++i) {
      const ClosestPoint& found = answers[i];
      EXPECT_TRUE(found.u >= 0 && found.v >= 0 && found.u + found.v <= 1) << "point " << i;
      const auto corners = test::CornersOf(data, found.primitive_id);
      const Vec3d on =
          corners[0] * (1 - found.u - found.v) + corners[1] * found.u + corners[2] * found.v;
      EXPECT_LT(MaxAbs(on - found.point), 1e-13) << "point " << i;
      EXPECT_NEAR(Length(points[i] - found.point), found.distance, 1e-13 * (1 + found.distance));
    }
  }
}

TEST(ClosestPoints, OfCornersEdgesAndFacesAreThePointsThemselves) {
  const Scene scene = test::MakeScene(test::Cube({0, 0, 0}, 1));
  for (const PointPrecision precision : {PointPrecision::kDouble, PointPrecision::kExact}) {
    for (const Vec3d& p : {Vec3d{1, 1, 1}, Vec3d{-1, 1, 0.5}, Vec3d{0.25, -1, 0.75}, Vec3d{0, 0, 1},
                           Vec3d{-1, -1, -1}}) {
      const ClosestPoint found = Find(scene, {p}, {.precision = precision, .cancel = {}})[0];
      EXPECT_EQ(found.distance, 0);
      EXPECT_EQ(found.point, p);
    }
    // At equal distance from the six faces, the smallest number of the twelve.
    EXPECT_EQ(Find(scene, {{0, 0, 0}}, {.precision = precision, .cancel = {}})[0].primitive_id, 0u);
  }
}

TEST(ClosestPoints, OfFarPointsAreTheOnesBelowThem) {
  const Scene scene = test::MakeScene(test::Cube({0, 0, 0}, 1));
  for (const double far : {1e2, 1e5, 1e10, 1e15, 1e100, 1e300}) {
    for (const PointPrecision precision : {PointPrecision::kDouble, PointPrecision::kExact}) {
      const ClosestPoint above =
          Find(scene, {{0.3, 0.2, far}}, {.precision = precision, .cancel = {}})[0];
      EXPECT_DOUBLE_EQ(above.distance, far - 1);
      EXPECT_LT(MaxAbs(above.point - Vec3d{0.3, 0.2, 1}), 1e-12) << far;
      const ClosestPoint corner =
          Find(scene, {{-far, far, far}}, {.precision = precision, .cancel = {}})[0];
      EXPECT_EQ(corner.point, (Vec3d{-1, 1, 1})) << far;
    }
  }
  constexpr double kMost = std::numeric_limits<double>::max();
  EXPECT_EQ(Find(scene, {{kMost, -kMost, kMost}}, {})[0].distance, kMost);
}

TEST(ClosestPoints, AreNoneForAnInvalidPointOrAMeshWithoutArea) {
  const Scene cube = test::MakeScene(test::Cube({0, 0, 0}, 1));
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  MeshData line;
  line.vertices = {{0, 0, 0}, {1, 1, 1}, {2, 2, 2}};
  line.triangles = {{0, 1, 2}};
  const Scene flat = test::MakeScene(line);
  for (const PointPrecision precision : {PointPrecision::kDouble, PointPrecision::kExact}) {
    const PointOptions options{.precision = precision, .cancel = {}};
    const auto answers = Find(cube, {{kNan, 0, 0}, {0, 0, 2}, {0, -kInfinity, 0}}, options);
    for (const std::size_t invalid : {0u, 2u}) {
      EXPECT_FALSE(answers[invalid].IsFound());
      EXPECT_TRUE(std::isnan(answers[invalid].distance));
    }
    EXPECT_EQ(answers[1].distance, 1);
    const ClosestPoint none = Find(flat, {{1, 0, 0}}, options)[0];
    EXPECT_FALSE(none.IsFound());
    EXPECT_EQ(none.distance, kInfinity);
  }
  EXPECT_TRUE(Find(cube, {}, {}).empty());
}

TEST(ClosestPoints, StopSoonAfterTheyAreCancelled) {
  // From the centre all triangles are equally far, so one point takes them all.
  const MeshData data = test::IcoSphere({0, 0, 0}, 1, 6);
  const Scene scene = test::MakeScene(data);
  for (const PointPrecision precision : {PointPrecision::kDouble, PointPrecision::kExact}) {
    const std::vector<Vec3d> points(4000);
    std::vector<ClosestPoint> answers(points.size());
    const auto call = test::CancelDuring(std::chrono::milliseconds(50), [&](CancelToken token) {
      return FindClosestPoints(scene, points, {.precision = precision, .cancel = token}, answers);
    });
    test::ExpectPrompt(call, "closest points");
  }
}

}  // namespace
}  // namespace kdray::core
