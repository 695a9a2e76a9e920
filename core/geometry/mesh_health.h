// SPDX-License-Identifier: Apache-2.0
// The health report of a mesh: the properties on which answers about inside and outside depend.
#pragma once

#include <cstdint>

#include "core/base/cancel.h"
#include "core/base/result.h"
#include "core/geometry/triangle_mesh.h"

namespace kdray::core {

/// Counts after joining vertices of exactly equal position (-0 is 0). An edge is a pair of joined
/// vertices. Degenerate triangles are counted as such and excluded from everything else. No ray
/// hits them, so where only such a triangle fills a T-junction, the mesh has open edges.
struct MeshHealth {
  std::uint64_t degenerate = 0;  ///< zero-area triangles
  std::uint64_t duplicate = 0;   ///< triangles with the corners of an earlier one, any order
  std::uint64_t concave = 0;     ///< polygons that are not convex (MeshData::concave)
  std::uint64_t open_edges = 0;  ///< edges of exactly one triangle
  std::uint64_t non_manifold_edges = 0;  ///< edges of more than two triangles
  /// There is an edge, and every edge has exactly two triangles, which run along it in opposite
  /// directions. Their orientation, inward or outward, is not checked.
  bool closed = false;
  /// Spacing of the file's number type (MeshData::single_precision) at the largest |coordinate|,
  /// mesh units.
  double coordinate_resolution = 0;
  friend bool operator==(const MeshHealth&, const MeshHealth&) = default;
};

/// `mesh` was made from `data`, whose triangles may be gone. O(n log n) time, whatever the
/// positions; at most 8 bytes of scratch a triangle and 10 a vertex. Deterministic. Errors:
/// kCancelled, kDeadlineExceeded.
Result<MeshHealth> CheckHealth(const TriangleMesh& mesh, const MeshData& data,
                               const CancelToken& cancel = {});

}  // namespace kdray::core
