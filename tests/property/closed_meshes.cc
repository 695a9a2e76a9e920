// SPDX-License-Identifier: Apache-2.0
#include "tests/property/closed_meshes.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <stdexcept>

#include "core/trace/trace.h"
#include "tests/property/scenes.h"
#include "tests/support/csv.h"
#include "tests/support/mesh_files.h"
#include "tests/support/seed.h"
#include "tests/support/shapes.h"

namespace kdray::test {

using namespace core;

namespace {

/// What is inside along lines through the bounds, the longer half of it.
std::vector<ClosedMesh::Inside> FindInside(const Scene& scene, std::mt19937_64& engine) {
  const Bounds3d& bounds = scene.mesh->bounds();
  std::vector<Ray> lines;
  while (lines.size() < 128) {
    const Vec3d target = PointIn(bounds, engine);
    Ray line = RayTo(target, PointIn(bounds, engine));
    const Vec3d direction = NormalizedAtAnyScale(line.direction);
    line.origin = target - direction * (2 * MaxAbs(bounds.Extent()));
    line.direction = direction * MaxAbs(bounds.Extent());
    if (IsValid(line)) lines.push_back(line);
  }
  const AllHits all =
      TraceAll(scene, std::span<const Ray>(lines), With(Precision::kExact), 1'000'000).value();
  std::vector<ClosedMesh::Inside> inside;
  for (std::size_t i = 0; i < lines.size(); ++i) {
    for (std::size_t k = all.first[i]; k + 1 < all.first[i + 1]; k += 2) {
      inside.push_back({lines[i].origin + lines[i].direction * all.hits[k].t,
                        lines[i].origin + lines[i].direction * all.hits[k + 1].t});
    }
  }
  const auto length = [](const ClosedMesh::Inside& s) { return MaxAbs(s.to - s.from); };
  std::sort(inside.begin(), inside.end(),
            [&](const auto& a, const auto& b) { return length(a) > length(b); });
  const auto is_short = [&](const auto& s) { return length(s) < 0.5 * length(inside.front()); };
  inside.erase(std::find_if(inside.begin(), inside.end(), is_short), inside.end());
  return inside;
}

const Vec3d& RandomVertex(const MeshData& data, std::mt19937_64& engine) {
  return data.vertices[data.triangles[engine() % data.triangles.size()][engine() % 3]];
}

}  // namespace

double RaysFactor() {
  const char* text = std::getenv("KDRAY_RAYS_FACTOR");
  return text != nullptr && *text != '\0' ? std::strtod(text, nullptr) : 1;
}

ClosedMesh MakeClosedMesh(std::string name, MeshData data) {
  ClosedMesh mesh{std::move(name), std::move(data), {}, {}};
  mesh.scene = MakeScene(mesh.data, BuildKind::kKdSah);
  auto engine = RandomEngine(3000);
  mesh.inside = FindInside(mesh.scene, engine);
  if (mesh.inside.empty()) throw std::runtime_error(mesh.name + " has no inside");
  return mesh;
}

std::vector<ClosedMesh> GeneratedClosedMeshes() {
  std::vector<ClosedMesh> meshes;
  meshes.push_back(MakeClosedMesh("sphere", RoundToFloat(UvSphere({0, 0, 0}, 1, 48, 96))));
  meshes.push_back(
      MakeClosedMesh("bumpy sphere", RoundToFloat(BumpySphere({0.3, -0.2, 0.1}, 1, 60, 120, 0.3))));
  meshes.push_back(MakeClosedMesh("icosphere", RoundToFloat(IcoSphere({0, 0, 0}, 1, 5))));
  meshes.push_back(MakeClosedMesh("sphere in double", UvSphere({0.1, 0.2, 0.3}, 1, 48, 96)));
  meshes.push_back(MakeClosedMesh("cube", Cube({0, 0, 0}, 1)));
  return meshes;
}

std::vector<std::string> ClosedCollectionFiles() {
  if (RaysFactor() <= 1) {
    return {"bunny_7k.off", "screwdriver_bigendian.ply", "armadillo_86k.ply",
            "OrientationTest.glb"};
  }
  std::vector<std::string> files;
  for (const CsvRow& row : ReadCsv(*MeshFolder() / "MANIFEST.csv")) {
    if (row.at("clean_solid") == "1") files.push_back(row.at("file"));
  }
  return files;
}

Vec3d RandomPointInside(const ClosedMesh& mesh, std::mt19937_64& engine) {
  const ClosedMesh::Inside& stretch = mesh.inside[engine() % mesh.inside.size()];
  return stretch.from + (stretch.to - stretch.from) * Uniform(engine, 0.1, 0.9);
}

std::vector<Ray> VertexRays(const ClosedMesh& mesh, std::size_t count, std::mt19937_64& engine) {
  std::vector<Ray> rays;
  while (rays.size() < count)
    rays.push_back(RayTo(RandomPointInside(mesh, engine), RandomVertex(mesh.data, engine)));
  return rays;
}

std::vector<Ray> EdgeRays(const ClosedMesh& mesh, std::size_t count, std::mt19937_64& engine) {
  std::vector<Ray> rays;
  while (rays.size() < count) {
    const TriangleIndices& t = mesh.data.triangles[engine() % mesh.data.triangles.size()];
    const std::size_t corner = engine() % 3;
    const Vec3d& a = mesh.data.vertices[t[corner]];
    const Vec3d& b = mesh.data.vertices[t[(corner + 1) % 3]];
    const double w = rays.size() % 2 == 0 ? 0.5 : Uniform(engine, 0, 1);
    rays.push_back(RayTo(RandomPointInside(mesh, engine), a * w + b * (1 - w)));
  }
  return rays;
}

std::vector<Ray> AxisRaysThroughVertices(const ClosedMesh& mesh, std::size_t count,
                                         std::mt19937_64& engine) {
  std::vector<Ray> rays;
  for (std::size_t tries = 0; rays.size() < count && tries < 20 * count + 1000; ++tries) {
    if (tries > 1000 && rays.empty()) break;  // a cube's vertices are nowhere beside its inside
    const int axis = static_cast<int>(engine() % 3);
    const Vec3d inside = RandomPointInside(mesh, engine);
    const Vec3d& first = RandomVertex(mesh.data, engine);
    const Vec3d& second = engine() % 2 == 0 ? first : RandomVertex(mesh.data, engine);
    Ray ray;
    ray.origin = inside;
    ray.origin[(axis + 1) % 3] = first[(axis + 1) % 3];
    ray.origin[(axis + 2) % 3] = second[(axis + 2) % 3];
    // Nothing lies between, and a little beyond: still inside.
    Ray way = RayTo(inside, ray.origin);
    way.t_max = 1.05;
    if (!IsValid(way) || AnyHit(mesh.scene, way, Precision::kExact)) continue;
    // The way is rounded and may pass by an edge on which the origin lies.
    Ray stay = way;
    stay.origin = ray.origin;
    stay.t_max = 0;
    if (AnyHit(mesh.scene, stay, Precision::kExact)) continue;
    for (int k = 0; k < 3; ++k) ray.direction[k] = engine() % 2 == 0 ? 0.0 : -0.0;
    ray.direction[axis] = engine() % 2 == 0 ? 1 : -1;
    rays.push_back(ray);
  }
  return rays;
}

std::vector<Ray> FarRays(const ClosedMesh& mesh, std::size_t count, std::mt19937_64& engine) {
  const double size = MaxAbs(mesh.scene.mesh->bounds().Extent());
  std::vector<Ray> rays;
  while (rays.size() < count) {
    const Vec3d inside = RandomPointInside(mesh, engine);
    const Vec3d& vertex = RandomVertex(mesh.data, engine);
    const double distance = size * std::pow(10.0, Uniform(engine, 3, 9));
    rays.push_back(RayTo(inside - NormalizedAtAnyScale(vertex - inside) * distance, vertex));
  }
  return rays;
}

}  // namespace kdray::test
