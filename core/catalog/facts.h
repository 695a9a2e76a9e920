// SPDX-License-Identifier: Apache-2.0
// The facts that describe a mesh and a tree without them.
#pragma once

#include <cstdint>
#include <optional>

#include "core/accel/build_kind.h"
#include "core/accel/tree_stats.h"
#include "core/geometry/bounds3.h"
#include "core/geometry/mesh_health.h"
#include "core/geometry/triangle_mesh.h"

namespace kdray::core {

struct MeshFacts {
  MeshFormat format = MeshFormat::kObj;
  std::uint64_t file_bytes = 0;
  std::uint64_t triangles = 0;
  std::uint64_t dropped = 0;   ///< faces with fewer than three corners; they have no number
  std::uint64_t vertices = 0;  ///< as stored in the file
  Bounds3d bounds;             ///< world units; of the vertices that triangles use
  MeshHealth health;
  bool double_vertices = false;      ///< local vertices are kept in double
  bool wider_than_declared = false;  ///< MeshData::wider_than_declared
  bool rounded_vertices = false;     ///< TriangleMesh::has_rounded_vertices
  MeshFrame frame;
  double shortest_edge = 0;        ///< TriangleMesh::shortest_edge, local units
  std::uint64_t memory_bytes = 0;  ///< of the mesh in memory
  double parse_ms = 0;             ///< time from bytes to mesh, health report included
  // Nullopt in records of older versions, and the volume of a mesh that is not closed.
  std::optional<double> area;           ///< MeshMeasure::area
  std::optional<double> volume;         ///< MeshMeasure::volume
  std::optional<std::uint32_t> groups;  ///< number of groups with triangles (MeshAttributes)
  friend bool operator==(const MeshFacts&, const MeshFacts&) = default;
};

/// The facts that describe a tree without it.
struct TreeFacts {
  BuildKind build = BuildKind::kBox;
  TreeStats stats;
  double build_ms = 0;  ///< when it was built
  friend bool operator==(const TreeFacts&, const TreeFacts&) = default;
};

}  // namespace kdray::core
