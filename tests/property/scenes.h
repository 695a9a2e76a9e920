// SPDX-License-Identifier: Apache-2.0
// Scenes and rays for the property tests.
#pragma once

#include <cstddef>
#include <cstdint>
#include <random>
#include <string>
#include <string_view>
#include <vector>

#include "core/geometry/ray.h"
#include "core/geometry/triangle_mesh.h"
#include "core/intersect/precision.h"
#include "core/scene/scene.h"
#include "core/trace/trace.h"

namespace kdray::test {

/// The mesh and one build over it; fails the test if either fails.
core::Scene MakeScene(const core::MeshData& data, core::BuildKind build);
/// One mesh shared by every build.
std::vector<core::Scene> MakeScenes(const core::MeshData& data);

/// The usual options in this precision.
core::TraceOptions With(core::Precision precision);

/// Every way to work off a batch: as the batch suggests, and each engine on each level of vectors
/// that the processor has, sorted and not.
std::vector<core::TraceOptions> WaysToTrace(core::Precision precision);
std::string Describe(const core::TraceOptions& way);

/// From the collection (tests/support/mesh_files.h), in any of its formats.
core::MeshData ReadCollectionMesh(std::string_view file);

/// A point strictly inside a closed mesh: halfway between the first two surfaces that a ray through
/// the middle of the bounds crosses.
core::Vec3d PointInside(const core::Scene& scene);

core::Ray RayTo(const core::Vec3d& origin, const core::Vec3d& target);

/// Rays from `origin` at the mesh's vertices, in file order, over again until there are `count`.
std::vector<core::Ray> RaysAtVertices(const core::MeshData& data, const core::Vec3d& origin,
                                      std::size_t count);
/// Rays from `origin` at points on the mesh's edges: the middle, and points drawn along them.
std::vector<core::Ray> RaysOnEdges(const core::MeshData& data, const core::Vec3d& origin,
                                   std::size_t count, std::mt19937_64& engine);
/// Lines between random points of the bounds, half of them starting a diagonal earlier.
std::vector<core::Ray> RandomRays(const core::Bounds3d& bounds, std::size_t count,
                                  std::mt19937_64& engine);

double Uniform(std::mt19937_64& engine, double low, double high);
core::Vec3d PointIn(const core::Bounds3d& bounds, std::mt19937_64& engine);

/// Closest and any hit of every build, against brute force with the same leaf test: each row must
/// be equal bit for bit.
void ExpectSameAsBruteForce(const core::MeshData& data, const std::vector<core::Ray>& rays,
                            const std::vector<core::Precision>& precisions);

}  // namespace kdray::test
