// The result of parsing a mesh file: the mesh that queries use, and its facts.
#pragma once

#include "core/catalog/facts.h"
#include "core/geometry/triangle_mesh.h"

namespace kdray::core {

struct ParsedMesh {
  MeshFacts facts;
  TriangleMesh mesh;
};

}  // namespace kdray::core
