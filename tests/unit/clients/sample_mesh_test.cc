// SPDX-License-Identifier: Apache-2.0
#include "clients/cpp/sample/sample_mesh.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <map>
#include <numbers>
#include <sstream>

#include "tests/support/mesh_files.h"

namespace kdray::client {
namespace {

SampleMesh Make(const char* name, int detail) {
  return MakeSample(*FindSampleShape(name), {.detail = detail});
}

// How often each directed edge is walked.
std::map<std::pair<std::uint32_t, std::uint32_t>, int> DirectedEdges(const SampleMesh& mesh) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> edges;
  for (const Face& face : mesh.triangles)
    for (int corner = 0; corner < 3; ++corner) ++edges[{face[corner], face[(corner + 1) % 3]}];
  return edges;
}

// Directed edges that are not walked once in each direction: 0 for a closed, oriented surface.
std::size_t UnmatchedEdges(const SampleMesh& mesh) {
  const auto edges = DirectedEdges(mesh);
  return static_cast<std::size_t>(std::count_if(edges.begin(), edges.end(), [&](const auto& edge) {
    const auto twin = edges.find({edge.first.second, edge.first.first});
    return edge.second != 1 || twin == edges.end() || twin->second != 1;
  }));
}

// V - E + F of a closed mesh: 2 a piece, 2 less for each handle.
long EulerCharacteristic(const SampleMesh& mesh) {
  return static_cast<long>(mesh.vertices.size()) -
         static_cast<long>(mesh.triangles.size() * 3 / 2) +
         static_cast<long>(mesh.triangles.size());
}

// By the divergence theorem; positive when the faces look outwards.
double Volume(const SampleMesh& mesh) {
  double volume = 0;
  for (const Face& face : mesh.triangles) {
    const Point& a = mesh.vertices[face[0]];
    const Point& b = mesh.vertices[face[1]];
    const Point& c = mesh.vertices[face[2]];
    volume += a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) +
              a[2] * (b[0] * c[1] - b[1] * c[0]);
  }
  return volume / 6;
}

TEST(SampleMesh, HasTheNumberOfTrianglesThatItsDescriptionSays) {
  for (const std::size_t n : {1u, 2u, 3u, 7u}) {
    SCOPED_TRACE(n);
    const int detail = static_cast<int>(n);
    EXPECT_EQ(Make("sphere", detail).triangles.size(), 20 * n * n);
    EXPECT_EQ(Make("cube", detail).triangles.size(), 12 * n * n);
    EXPECT_EQ(Make("terrain", detail).triangles.size(), 2 * n * n);
    const std::size_t ring = std::max<std::size_t>(n, 3);  // fewer make no tube
    EXPECT_EQ(Make("torus", detail).triangles.size(), 4 * ring * ring);
    // 24 turned patches, less a triangle for each quad at the two poles; the gap's ring; two tubes
    // of four patches with two caps each, whose outermost quads are triangles.
    const std::size_t pot = 2 * 24 * n * n - 2 * 4 * n + 2 * 4 * n;
    const std::size_t tube = 2 * 4 * n * n + 2 * (n == 1 ? 0 : 2 * n - 2);
    EXPECT_EQ(Make("teapot", detail).triangles.size(), pot + 2 * tube);
  }
}

TEST(SampleMesh, EveryShapeButTheTerrainIsClosedAndFacesOutwards) {
  const struct {
    const char* name;
    long euler_characteristic;
  } kCases[] = {{"sphere", 2}, {"cube", 2}, {"torus", 0}, {"teapot", 6}};
  for (const auto& test : kCases) {
    for (const int detail : {2, 3, 10}) {
      SCOPED_TRACE(std::string(test.name) + " " + std::to_string(detail));
      const SampleMesh mesh = Make(test.name, detail);
      EXPECT_EQ(UnmatchedEdges(mesh), 0u);
      EXPECT_EQ(EulerCharacteristic(mesh), test.euler_characteristic);
      EXPECT_GT(Volume(mesh), 0);
    }
  }
}

TEST(SampleMesh, TheTerrainIsOpenAtItsRimOnly) {
  EXPECT_EQ(UnmatchedEdges(Make("terrain", 16)), 4u * 16);
}

TEST(SampleMesh, ShapesHaveTheVolumesOfTheirFormulas) {
  EXPECT_NEAR(Volume(Make("sphere", 64)), 4.0 / 3 * std::numbers::pi, 3e-3);
  EXPECT_NEAR(Volume(Make("cube", 5)), 8, 1e-12);
  EXPECT_NEAR(Volume(Make("torus", 128)), 2 * std::pow(std::numbers::pi * 0.4, 2), 3e-3);
}

TEST(SampleMesh, EveryVertexOfTheSphereIsOnIt) {
  for (const Point& p : Make("sphere", 9).vertices)
    EXPECT_NEAR(std::hypot(p[0], p[1], p[2]), 1, 1e-15);
}

TEST(SampleMesh, TheTerrainIsTheSameForTheSameSeed) {
  const SampleShape& terrain = *FindSampleShape("terrain");
  const auto first = MakeSample(terrain, {.detail = 8, .seed = 5}).vertices;
  EXPECT_EQ(first, MakeSample(terrain, {.detail = 8, .seed = 5}).vertices);
  EXPECT_NE(first, MakeSample(terrain, {.detail = 8, .seed = 6}).vertices);
}

TEST(SampleMesh, TheTeapotHasTheExtentOfNewells) {
  Point low;
  low.fill(std::numeric_limits<double>::infinity());
  Point high;
  high.fill(-std::numeric_limits<double>::infinity());
  for (const Point& p : Make("teapot", 20).vertices) {
    for (int axis = 0; axis < 3; ++axis) {
      low[axis] = std::min(low[axis], p[axis]);
      high[axis] = std::max(high[axis], p[axis]);
    }
  }
  EXPECT_EQ(low, (Point{-3, 0, -2}));
  EXPECT_EQ(high[1], 3.15);
  EXPECT_EQ(high[2], 2);
  EXPECT_NEAR(high[0], 3.434, 1e-3);  // the spout's curve passes inside its control points
}

// A tessellation made by others (10 x 10 a patch): all its vertices are vertices of ours.
TEST(SampleMesh, TheTeapotAgreesWithAWellKnownTessellation) {
  KDRAY_NEED_MESHES();
  const SampleMesh ours = Make("teapot", 10);
  std::ifstream file(*test::MeshFolder() / "teapot.obj");
  std::string line;
  int compared = 0;
  while (std::getline(file, line)) {
    if (!line.starts_with("v ")) continue;
    Point p;
    std::istringstream(line.substr(2)) >> p[0] >> p[1] >> p[2];
    double nearest = std::numeric_limits<double>::infinity();
    for (const Point& q : ours.vertices)
      nearest = std::min(nearest, std::hypot(p[0] - q[0], p[1] - q[1], p[2] - q[2]));
    ASSERT_LT(nearest, 2e-6) << line;  // the file has six decimals
    ++compared;
  }
  EXPECT_GT(compared, 3000);
}

}  // namespace
}  // namespace kdray::client
