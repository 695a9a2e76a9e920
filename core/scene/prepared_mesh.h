// What becomes of a mesh file: the mesh that queries run on, and all that can be said about it
// without keeping it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "core/base/cancel.h"
#include "core/base/result.h"
#include "core/geometry/bounds3.h"
#include "core/geometry/mesh_health.h"
#include "core/geometry/triangle_mesh.h"
#include "core/tree/build_kind.h"
#include "core/tree/tree_stats.h"

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
  double parse_ms = 0;             ///< time from bytes to mesh, health included, when it was parsed
  friend bool operator==(const MeshFacts&, const MeshFacts&) = default;
};

struct PreparedMesh {
  MeshFacts facts;
  TriangleMesh mesh;
};

/// Parses, validates and judges a mesh file, in the caller's arena. Errors: those of ReadMesh and
/// TriangleMesh::Create.
Result<PreparedMesh> PrepareMesh(std::span<const std::byte> bytes, const CancelToken& cancel);

/// What usual files come to while they are prepared, `file_bytes` of input included, for those
/// whose counts are not known yet; others need up to 25 times as much as their bytes. With counts:
/// PreparePeakBytes (core/scene/mesh_memory.h).
constexpr std::uint64_t EstimatePrepareBytes(std::uint64_t file_bytes) { return 5 * file_bytes; }

/// What no mesh of so many bytes can do without: its bytes are held while they are parsed.
constexpr std::uint64_t LeastPrepareBytes(std::uint64_t file_bytes) { return file_bytes + 4096; }

/// What can be said about a tree without keeping it.
struct TreeFacts {
  BuildKind build = BuildKind::kBox;
  TreeStats stats;
  double build_ms = 0;  ///< when it was built
  friend bool operator==(const TreeFacts&, const TreeFacts&) = default;
};

}  // namespace kdray::core
