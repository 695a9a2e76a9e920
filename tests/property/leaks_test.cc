// SPDX-License-Identifier: Apache-2.0
// N01 to N04, N07, N15: a ray from strictly inside a closed mesh must hit it, wherever it is aimed,
// whatever the mesh's size and place; and so must one from far away through a point inside. No
// arithmetic is needed to know the answer. t is compared with that of `exact`.
#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "core/trace/trace.h"
#include "tests/property/aimed_run.h"
#include "tests/property/closed_meshes.h"
#include "tests/property/scenes.h"
#include "tests/support/mesh_files.h"
#include "tests/support/seed.h"
#include "tests/support/shapes.h"

namespace kdray::test {
namespace {

using namespace core;

/// A family's rays on generated meshes, and as many again on the collection.
std::size_t RaysOfAFamily() { return static_cast<std::size_t>(100'000 * RaysFactor()); }

void RunOnGenerated(const char* name, const RayFamily& family, std::vector<ClosedMesh> meshes,
                    std::uint64_t stream) {
  auto engine = RandomEngine(stream);
  std::size_t left = RaysOfAFamily();
  for (std::size_t i = 0; i < meshes.size(); ++i) {
    const AimedRun run = RunAimed(meshes[i], family, left / (meshes.size() - i), engine);
    left -= run.rays;
    if (run.rays != 0) ExpectTight(name, meshes[i].name, run);
  }
}

void RunOnCollection(const char* name, const RayFamily& family, std::uint64_t stream) {
  auto engine = RandomEngine(stream);
  std::size_t left = RaysOfAFamily();
  const std::vector<std::string> files = ClosedCollectionFiles();
  for (std::size_t i = 0; i < files.size(); ++i) {
    const ClosedMesh mesh = MakeClosedMesh(files[i], ReadCollectionMesh(files[i]));
    const AimedRun run = RunAimed(mesh, family, left / (files.size() - i), engine);
    left -= run.rays;
    if (run.rays != 0) ExpectTight(name, files[i], run);
  }
}

TEST(N01AtVertices, RaysAtVerticesOfClosedMeshesDoNotLeak) {
  RunOnGenerated("N01 vertices", VertexRays, GeneratedClosedMeshes(), 101);
}
TEST(N01AtVertices, RaysAtVerticesOfTheCollectionsClosedMeshesDoNotLeak) {
  KDRAY_NEED_MESHES();
  RunOnCollection("N01 vertices", VertexRays, 102);
}

TEST(N02AtEdges, RaysAtEdgesOfClosedMeshesDoNotLeak) {
  RunOnGenerated("N02 edges", EdgeRays, GeneratedClosedMeshes(), 103);
}
TEST(N02AtEdges, RaysAtEdgesOfTheCollectionsClosedMeshesDoNotLeak) {
  KDRAY_NEED_MESHES();
  RunOnCollection("N02 edges", EdgeRays, 104);
}

TEST(N07AxisParallel, AxisParallelRaysFromInsideClosedMeshesDoNotLeak) {
  RunOnGenerated("N07 axes", AxisRaysThroughVertices, GeneratedClosedMeshes(), 105);
}
TEST(N07AxisParallel, AxisParallelRaysFromInsideTheCollectionsClosedMeshesDoNotLeak) {
  KDRAY_NEED_MESHES();
  RunOnCollection("N07 axes", AxisRaysThroughVertices, 106);
}

TEST(N15FarRays, RaysFromFarAwayThroughClosedMeshesDoNotPassThem) {
  RunOnGenerated("N15 far", FarRays, GeneratedClosedMeshes(), 107);
}
TEST(N15FarRays, RaysFromFarAwayThroughTheCollectionsClosedMeshesDoNotPassThem) {
  KDRAY_NEED_MESHES();
  RunOnCollection("N15 far", FarRays, 108);
}

/// Vertices and edges in turn.
std::vector<Ray> VertexAndEdgeRays(const ClosedMesh& mesh, std::size_t count,
                                   std::mt19937_64& engine) {
  std::vector<Ray> rays = VertexRays(mesh, count / 2, engine);
  for (const Ray& ray : EdgeRays(mesh, count - count / 2, engine)) rays.push_back(ray);
  return rays;
}

TEST(N03FarFromOrigin, RaysInClosedMeshesFarFromTheOriginDoNotLeak) {
  std::vector<ClosedMesh> meshes;
  meshes.push_back(
      MakeClosedMesh("sphere of 2 at 1e5", UvSphere({148'376, 1'234, -223'423}, 2, 24, 48)));
  meshes.push_back(MakeClosedMesh("sphere of 2 at 1e5, in float",
                                  RoundToFloat(UvSphere({148'376, 1'234, -223'423}, 2, 24, 48))));
  meshes.push_back(
      MakeClosedMesh("sphere of 1000 at 1e7", UvSphere({1e7, -1e7, 1e7}, 1000, 48, 96)));
  meshes.push_back(MakeClosedMesh("sphere of 1 at 1e9", UvSphere({1e9, 0, -1e9}, 1, 24, 48)));
  // Coordinates like those of a map: metres, with millimetres after the decimal point.
  MeshData map = BumpySphere({448'251.25, 5'411'932.5, 122.75}, 40, 40, 80, 0.3);
  for (Vec3d& v : map.vertices) {
    for (int axis = 0; axis < 3; ++axis) v[axis] = std::round(v[axis] * 1000) / 1000;
  }
  meshes.push_back(MakeClosedMesh("map coordinates in millimetres", std::move(map)));
  for (const ClosedMesh& mesh : meshes) {
    const bool is_float = mesh.name.ends_with("in float");
    EXPECT_EQ(AutoPrecision(*mesh.scene.mesh),
              is_float ? Precision::kWatertight : Precision::kDouble)
        << mesh.name;
  }
  RunOnGenerated("N03 far from the origin", VertexAndEdgeRays, std::move(meshes), 109);
}

TEST(N04AnyScale, RaysInClosedMeshesOfAnyScaleDoNotLeak) {
  std::vector<ClosedMesh> meshes;
  for (const int exponent : {-30, -20, -15, -10, 0, 10, 15, 20, 30}) {
    const double scale = std::pow(10.0, exponent);
    const std::string name = "sphere of 1e" + std::to_string(exponent);
    const Vec3d center = Vec3d{0.3, -0.2, 0.1} * scale;
    meshes.push_back(MakeClosedMesh(name, UvSphere(center, scale, 24, 48)));
    meshes.push_back(
        MakeClosedMesh(name + " in float", RoundToFloat(UvSphere(center, scale, 24, 48))));
    EXPECT_EQ(AutoPrecision(*meshes.back().scene.mesh), Precision::kWatertight) << name;
  }
  RunOnGenerated("N04 scales", VertexAndEdgeRays, std::move(meshes), 110);
}

TEST(N01AtVertices, EveryBuildIsAsTightAsTheOthers) {
  const MeshData data = RoundToFloat(IcoSphere({0, 0, 0}, 1, 3));
  auto engine = RandomEngine(4);
  std::vector<Ray> rays = RaysAtVertices(data, {0.1, 0.2, -0.1}, 4'000);
  for (const Ray& ray : RaysOnEdges(data, {0.1, 0.2, -0.1}, 4'000, engine)) rays.push_back(ray);
  for (const Scene& scene : MakeScenes(data)) {
    for (const Precision precision :
         {Precision::kWatertight, Precision::kDouble, Precision::kExact}) {
      std::vector<std::uint8_t> occluded(rays.size());
      ASSERT_TRUE(TraceAny(scene, std::span<const Ray>(rays), With(precision), occluded).ok());
      EXPECT_EQ(std::count(occluded.begin(), occluded.end(), 0), 0)
          << Name(scene.tree->build) << ", " << Name(precision);
    }
  }
}

}  // namespace
}  // namespace kdray::test
