// The health report of a mesh: what a caller should know before trusting answers about inside and
// outside.
#pragma once

#include <cstdint>

#include "core/geometry/triangle_mesh.h"

namespace kdray::core {

/// Counts over all triangles, after joining vertices of equal position. An edge is a pair of joined
/// vertices.
struct MeshHealth {
  std::uint64_t degenerate = 0;  ///< zero-area triangles
  std::uint64_t duplicate =
      0;  ///< triangles with the same three corners as an earlier one, in any order
  std::uint64_t concave = 0;             ///< polygons that were cut by ears
  std::uint64_t open_edges = 0;          ///< edges of exactly one non-degenerate triangle
  std::uint64_t non_manifold_edges = 0;  ///< edges of more than two
  bool closed =
      false;  ///< every edge has exactly two triangles, which run along it in opposite directions
  double coordinate_resolution =
      0;  ///< spacing of the file's number type at the largest |coordinate|, mesh units
  friend bool operator==(const MeshHealth&, const MeshHealth&) = default;
};

/// O(n log n) time, about 40 bytes a triangle of scratch. Deterministic.
MeshHealth CheckHealth(const TriangleMesh& mesh, const MeshData& data);

}  // namespace kdray::core
