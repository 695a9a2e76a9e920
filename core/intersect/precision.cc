// SPDX-License-Identifier: Apache-2.0
#include "core/intersect/precision.h"

namespace kdray::core {

Precision AutoPrecision(const TriangleMesh& mesh) {
  return AutoPrecision(mesh.has_double_vertices(), mesh.shortest_edge());
}

Precision AutoPrecision(bool has_double_vertices, double shortest_edge) {
  if (has_double_vertices) return Precision::kDouble;
  // The largest |local coordinate| is in [0.5, 1): a float then resolves the shortest edge with at
  // least 4 bits.
  return shortest_edge > 0x1p-20 ? Precision::kWatertight : Precision::kDouble;
}

}  // namespace kdray::core
