// SPDX-License-Identifier: Apache-2.0
#include "tests/property/scenes.h"

#include <gtest/gtest.h>

#include <bit>
#include <stdexcept>
#include <string>

#include "core/io/mesh_reader.h"
#include "core/trace/brute_force.h"
#include "core/trace/trace.h"
#include "tests/support/gltf_mesh.h"
#include "tests/support/mesh_files.h"

namespace kdray::test {

using namespace core;

namespace {

std::shared_ptr<const TriangleMesh> MakeMesh(const MeshData& data) {
  Result<TriangleMesh> mesh = TriangleMesh::Create(data);
  if (!mesh) throw std::runtime_error(mesh.error().message);
  return std::make_shared<const TriangleMesh>(*std::move(mesh));
}

std::shared_ptr<const Tree> MakeTree(const TriangleMesh& mesh, BuildKind build) {
  Result<Tree> tree = BuildTree(mesh, build);
  if (!tree) throw std::runtime_error(tree.error().message);
  return std::make_shared<const Tree>(*std::move(tree));
}

bool SameBits(double a, double b) {
  return std::bit_cast<std::uint64_t>(a) == std::bit_cast<std::uint64_t>(b);
}

/// NaN rows included: bit for bit.
bool SameHit(const Hit& a, const Hit& b) {
  return SameBits(a.t, b.t) && SameBits(a.u, b.u) && SameBits(a.v, b.v) &&
         a.primitive_id == b.primitive_id;
}

std::string Describe(const Ray& r) {
  const auto text = [](const Vec3d& v) {
    return std::to_string(v.x) + " " + std::to_string(v.y) + " " + std::to_string(v.z);
  };
  return "origin " + text(r.origin) + " direction " + text(r.direction);
}

}  // namespace

Scene MakeScene(const MeshData& data, BuildKind build) {
  auto mesh = MakeMesh(data);
  auto tree = MakeTree(*mesh, build);
  return {mesh, tree};
}

std::vector<Scene> MakeScenes(const MeshData& data) {
  const auto mesh = MakeMesh(data);
  std::vector<Scene> scenes;
  for (const BuildKind build : kAllBuildKinds) scenes.push_back({mesh, MakeTree(*mesh, build)});
  return scenes;
}

std::vector<TraceOptions> WaysToTrace(Precision precision) {
  std::vector<TraceOptions> ways = {With(precision)};
  for (const SimdLevel level : SupportedSimdLevels()) {
    for (const KernelKind kernel : kAllKernelKinds) {
      for (const bool sort : {false, true}) {
        TraceOptions way = With(precision);
        way.simd = level;
        way.kernel = kernel;
        way.sort = sort;
        ways.push_back(way);
      }
    }
  }
  return ways;
}

std::string Describe(const TraceOptions& way) {
  std::string text(Name(way.precision));
  if (way.simd) text += ", " + std::string(Name(*way.simd));
  if (way.kernel) text += ", " + std::string(Name(*way.kernel));
  if (way.sort && *way.sort) text += ", sorted";
  return text;
}

TraceOptions With(Precision precision) {
  TraceOptions options;
  options.precision = precision;
  return options;
}

MeshData ReadCollectionMesh(std::string_view file) {
  const std::vector<std::byte> bytes = ReadFileBytes(*MeshFolder() / file);
  if (file.ends_with(".glb") || file.ends_with(".gltf")) return ReadGltf(bytes);
  Result<MeshData> data = ReadMesh(bytes);
  if (!data) throw std::runtime_error(data.error().message);
  return *std::move(data);
}

Vec3d PointInside(const Scene& scene) {
  const Bounds3d& bounds = scene.mesh->bounds();
  // Not along an axis, so that no symmetry of the mesh is in the way.
  Ray ray = RayTo(bounds.min - bounds.Extent() * 0.31, bounds.Center() + bounds.Extent() * 0.0137);
  const Hit first = ClosestHit(scene, ray, Precision::kExact);
  if (!first.IsHit()) throw std::runtime_error("the middle of the bounds is not in the mesh");
  ray.t_min = first.t * (1 + 1e-9);
  const Hit second = ClosestHit(scene, ray, Precision::kExact);
  if (!second.IsHit()) throw std::runtime_error("the mesh is not closed");
  return ray.origin + ray.direction * (0.5 * (first.t + second.t));
}

Ray RayTo(const Vec3d& origin, const Vec3d& target) {
  Ray ray;
  ray.origin = origin;
  ray.direction = target - origin;
  return ray;
}

std::vector<Ray> RaysAtVertices(const MeshData& data, const Vec3d& origin, std::size_t count) {
  std::vector<Ray> rays;
  for (std::size_t i = 0; rays.size() < count; ++i) {
    rays.push_back(
        RayTo(origin, data.vertices[data.triangles[i / 3 % data.triangles.size()][i % 3]]));
  }
  return rays;
}

std::vector<Ray> RaysOnEdges(const MeshData& data, const Vec3d& origin, std::size_t count,
                             std::mt19937_64& engine) {
  std::vector<Ray> rays;
  for (std::size_t i = 0; rays.size() < count; ++i) {
    const TriangleIndices& t = data.triangles[i / 3 % data.triangles.size()];
    const Vec3d& a = data.vertices[t[i % 3]];
    const Vec3d& b = data.vertices[t[(i + 1) % 3]];
    const double w = i % 2 == 0 ? 0.5 : Uniform(engine, 0, 1);
    rays.push_back(RayTo(origin, a * w + b * (1 - w)));
  }
  return rays;
}

std::vector<Ray> RandomRays(const Bounds3d& bounds, std::size_t count, std::mt19937_64& engine) {
  std::vector<Ray> rays;
  while (rays.size() < count) {
    Ray ray = RayTo(PointIn(bounds, engine), PointIn(bounds, engine));
    if (rays.size() % 2 == 1)
      ray.origin = ray.origin - Normalized(ray.direction) * Length(bounds.Extent());
    if (IsValid(ray)) rays.push_back(ray);
  }
  return rays;
}

double Uniform(std::mt19937_64& engine, double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(engine);
}

Vec3d PointIn(const Bounds3d& bounds, std::mt19937_64& engine) {
  const Vec3d e = bounds.Extent();
  return bounds.min + Vec3d{e.x * Uniform(engine, 0, 1), e.y * Uniform(engine, 0, 1),
                            e.z * Uniform(engine, 0, 1)};
}

void ExpectSameAsBruteForce(const MeshData& data, const std::vector<Ray>& rays,
                            const std::vector<Precision>& precisions) {
  const std::vector<Scene> scenes = MakeScenes(data);
  for (const Precision precision : precisions) {
    std::vector<Hit> expected;
    for (const Ray& ray : rays)
      expected.push_back(BruteForceClosest(*scenes[0].mesh, ray, precision));
    // One scene after the other by every way; all of them by the usual one.
    const std::vector<TraceOptions> ways = WaysToTrace(precision);
    for (std::size_t k = 0; k < std::max(scenes.size(), ways.size()); ++k) {
      const Scene& scene = scenes[k % scenes.size()];
      const TraceOptions& way = k < scenes.size() ? ways[0] : ways[k % ways.size()];
      std::vector<Hit> hits(rays.size());
      std::vector<std::uint8_t> occluded(rays.size());
      const std::span<const Ray> batch(rays);
      ASSERT_TRUE(TraceClosest(scene, batch, way, hits).ok());
      ASSERT_TRUE(TraceAny(scene, batch, way, occluded).ok());
      for (std::size_t i = 0; i < rays.size(); ++i) {
        ASSERT_TRUE(SameHit(hits[i], expected[i]))
            << Name(scene.tree->build) << ", " << Describe(way) << ", ray " << i << ": "
            << Describe(rays[i]) << "\n  tree  t " << hits[i].t << " triangle "
            << hits[i].primitive_id << "\n  brute t " << expected[i].t << " triangle "
            << expected[i].primitive_id;
        ASSERT_EQ(occluded[i] != 0, expected[i].IsHit())
            << Name(scene.tree->build) << ", ray " << i;
      }
    }
  }
}

}  // namespace kdray::test
