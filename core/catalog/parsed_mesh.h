// SPDX-License-Identifier: Apache-2.0
// The result of parsing a mesh file: the mesh that queries use, and its facts.
#pragma once

#include <string>
#include <vector>

#include "core/catalog/facts.h"
#include "core/geometry/triangle_mesh.h"

namespace kdray::core {

struct ParsedMesh {
  MeshFacts facts;
  TriangleMesh mesh;
  /// Of a mesh that was just parsed; the loader stores them apart and empties the list.
  std::vector<std::string> group_names = {};
};

}  // namespace kdray::core
