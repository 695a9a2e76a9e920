// N01, N02: a ray from strictly inside a closed mesh must hit it, wherever it is aimed. No
// arithmetic is needed to know the answer.
#include <gtest/gtest.h>

#include <string>

#include "core/trace/trace.h"
#include "tests/property/scenes.h"
#include "tests/support/mesh_files.h"
#include "tests/support/seed.h"
#include "tests/support/shapes.h"

namespace kdray::test {
namespace {

using namespace core;

constexpr std::size_t kRays = 100'000;  // for each mesh and precision

std::size_t Leaks(const Scene& scene, const std::vector<Ray>& rays, Precision precision) {
  std::vector<Hit> hits(rays.size());
  EXPECT_TRUE(TraceClosest(scene, std::span<const Ray>(rays), {precision, {}}, hits).ok());
  std::size_t leaks = 0;
  for (const Hit& hit : hits) leaks += hit.IsHit() ? 0 : 1;
  return leaks;
}

void ExpectNoLeaks(const std::string& name, const Scene& scene, const std::vector<Ray>& rays) {
  EXPECT_EQ(Leaks(scene, rays, Precision::kWatertight), 0u) << name << ", of " << rays.size();
  EXPECT_EQ(Leaks(scene, rays, Precision::kDouble), 0u) << name << ", of " << rays.size();
  // Every one of these rays is degenerate, which `exact` decides with long integers: fewer do.
  const std::vector<Ray> some(rays.begin(),
                              rays.begin() + static_cast<std::ptrdiff_t>(rays.size() / 10));
  EXPECT_EQ(Leaks(scene, some, Precision::kExact), 0u) << name << ", of " << some.size();
  // `fast` promises nothing here; its rate is printed, as the documentation tells it.
  std::printf("%s: fast leaks %zu of %zu\n", name.c_str(), Leaks(scene, rays, Precision::kFast),
              rays.size());
}

struct ClosedMesh {
  std::string name;
  MeshData data;
  Vec3d inside;
};

std::vector<ClosedMesh> GeneratedMeshes() {
  const Vec3d far{148'376, 1'234, -223'423};
  return {
      {"sphere", RoundToFloat(UvSphere({0, 0, 0}, 1, 48, 96)), {0.01, 0.02, 0.03}},
      {"bumpy sphere",
       RoundToFloat(BumpySphere({0.3, -0.2, 0.1}, 1, 60, 120, 0.3)),
       {0.31, -0.21, 0.12}},
      {"icosphere", RoundToFloat(IcoSphere({0, 0, 0}, 1, 5)), {0.1, 0.2, -0.1}},
      {"cube", Cube({0, 0, 0}, 1), {0.125, 0.25, -0.5}},
      {"sphere far from the origin", RoundToFloat(UvSphere(far, 2, 24, 48)),
       far + Vec3d{0.1, 0.2, 0.3}},
  };
}

TEST(N01, RaysAtVerticesOfClosedMeshesDoNotLeak) {
  for (const ClosedMesh& mesh : GeneratedMeshes()) {
    ExpectNoLeaks(mesh.name, MakeScene(mesh.data, BuildKind::kKdSah),
                  RaysAtVertices(mesh.data, mesh.inside, kRays));
  }
}

TEST(N02, RaysAtEdgesOfClosedMeshesDoNotLeak) {
  auto engine = RandomEngine(2);
  for (const ClosedMesh& mesh : GeneratedMeshes()) {
    ExpectNoLeaks(mesh.name, MakeScene(mesh.data, BuildKind::kKdSah),
                  RaysOnEdges(mesh.data, mesh.inside, kRays, engine));
  }
}

constexpr const char* kClosedScans[] = {"bunny_7k.off", "screwdriver_bigendian.ply",
                                        "armadillo_86k.ply"};

TEST(N01, RaysAtVerticesOfClosedScansDoNotLeak) {
  KDRAY_NEED_MESHES();
  for (const char* file : kClosedScans) {
    const MeshData data = ReadCollectionMesh(file);
    const Scene scene = MakeScene(data, BuildKind::kKdSah);
    ExpectNoLeaks(file, scene, RaysAtVertices(data, PointInside(scene), kRays));
  }
}

TEST(N02, RaysAtEdgesOfClosedScansDoNotLeak) {
  KDRAY_NEED_MESHES();
  auto engine = RandomEngine(3);
  for (const char* file : kClosedScans) {
    const MeshData data = ReadCollectionMesh(file);
    const Scene scene = MakeScene(data, BuildKind::kKdSah);
    ExpectNoLeaks(file, scene, RaysOnEdges(data, PointInside(scene), kRays, engine));
  }
}

TEST(N01, EveryBuildIsAsTightAsTheOthers) {
  const MeshData data = RoundToFloat(IcoSphere({0, 0, 0}, 1, 3));
  auto engine = RandomEngine(4);
  std::vector<Ray> rays = RaysAtVertices(data, {0.1, 0.2, -0.1}, 4'000);
  for (const Ray& ray : RaysOnEdges(data, {0.1, 0.2, -0.1}, 4'000, engine)) rays.push_back(ray);
  for (const Scene& scene : MakeScenes(data)) {
    for (const Precision precision :
         {Precision::kWatertight, Precision::kDouble, Precision::kExact}) {
      EXPECT_EQ(Leaks(scene, rays, precision), 0u)
          << Name(scene.tree->build) << ", " << Name(precision);
    }
  }
}

}  // namespace
}  // namespace kdray::test
