// SPDX-License-Identifier: Apache-2.0
// Area and volume of a mesh.
#pragma once

#include "core/base/cancel.h"
#include "core/base/result.h"
#include "core/geometry/triangle_mesh.h"

namespace kdray::core {

struct MeshMeasure {
  double area = 0;    ///< the sum of the triangles' areas, square mesh units
  double volume = 0;  ///< enclosed by a closed mesh, cubic mesh units; negative if it is inside out
};

/// Sums over the triangles in their order, compensated (Neumaier, "Rundungsfehleranalyse einiger
/// Verfahren zur Summation endlicher Summen", 1974), so the result depends on the mesh alone. The
/// volume of a mesh that is not closed has no meaning. Computed in the mesh's frame, so a distant
/// position costs no digits. kCancelled, kDeadlineExceeded. O(triangles).
Result<MeshMeasure> MeasureMesh(const TriangleMesh& mesh, const CancelToken& cancel = {});

}  // namespace kdray::core
