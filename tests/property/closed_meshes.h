// SPDX-License-Identifier: Apache-2.0
// Closed meshes with points that are certainly inside, and families of rays aimed from there at the
// hardest targets for float arithmetic. Each such ray must hit; this needs no arithmetic.
#pragma once

#include <cstddef>
#include <functional>
#include <random>
#include <string>
#include <vector>

#include "core/geometry/ray.h"
#include "core/geometry/triangle_mesh.h"
#include "core/scene/scene.h"

namespace kdray::test {

/// The factor of the accuracy tests' numbers of rays: the environment variable KDRAY_RAYS_FACTOR,
/// else 1. tests/accuracy sets it.
double RaysFactor();

struct ClosedMesh {
  std::string name;
  core::MeshData data;
  core::Scene scene;
  /// Segments that are inside the mesh by exact parity, with ends on its surface.
  struct Inside {
    core::Vec3d from, to;
  };
  std::vector<Inside> inside;
};

/// With a kd-sah tree. Throws std::runtime_error if the mesh has no inside.
ClosedMesh MakeClosedMesh(std::string name, core::MeshData data);

/// Spheres of several kinds and a cube around the origin, of size 1.
std::vector<ClosedMesh> GeneratedClosedMeshes();
/// Closed meshes of the collection (tests/support/mesh_files.h): three scans and one of several
/// parts, or, with more rays than usual, every file that MANIFEST.csv lists as a clean solid.
std::vector<std::string> ClosedCollectionFiles();

/// Strictly inside, away from the surface by a tenth of its segment.
core::Vec3d RandomPointInside(const ClosedMesh& mesh, std::mt19937_64& engine);

/// `count` rays that must hit; fewer if the mesh does not have as many.
using RayFamily = std::function<std::vector<core::Ray>(const ClosedMesh& mesh, std::size_t count,
                                                       std::mt19937_64& engine)>;
/// N01: from inside, at vertices.
std::vector<core::Ray> VertexRays(const ClosedMesh& mesh, std::size_t count,
                                  std::mt19937_64& engine);
/// N02: from inside, at points on edges, every second one the middle.
std::vector<core::Ray> EdgeRays(const ClosedMesh& mesh, std::size_t count, std::mt19937_64& engine);
/// N07: from inside, along an axis, two coordinates copied from a vertex; zeros of both signs. Such
/// rays lie in split planes and box faces.
std::vector<core::Ray> AxisRaysThroughVertices(const ClosedMesh& mesh, std::size_t count,
                                               std::mt19937_64& engine);
/// N15: from 10^3 to 10^9 mesh sizes away, through a point inside, at a vertex.
std::vector<core::Ray> FarRays(const ClosedMesh& mesh, std::size_t count, std::mt19937_64& engine);

}  // namespace kdray::test
