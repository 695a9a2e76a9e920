// SPDX-License-Identifier: Apache-2.0
// A mesh in memory as the text of an OBJ file.
#pragma once

#include <cstdio>
#include <string>

#include "core/geometry/triangle_mesh.h"

namespace kdray::test {

/// Every coordinate with 17 digits: reading the text gives the same doubles.
inline std::string ObjText(const core::MeshData& mesh) {
  std::string text;
  char line[128];
  for (const core::Vec3d& p : mesh.vertices) {
    std::snprintf(line, sizeof(line), "v %.17g %.17g %.17g\n", p.x, p.y, p.z);
    text += line;
  }
  for (const auto& t : mesh.triangles) {
    std::snprintf(line, sizeof(line), "f %u %u %u\n", t[0] + 1, t[1] + 1, t[2] + 1);
    text += line;
  }
  return text;
}

}  // namespace kdray::test
