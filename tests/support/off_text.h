// SPDX-License-Identifier: Apache-2.0
// A mesh as the bytes of an OFF file, with every digit.
#pragma once

#include <charconv>
#include <cstddef>
#include <string>
#include <vector>

#include "core/geometry/triangle_mesh.h"

namespace kdray::test {

inline std::vector<std::byte> OffBytes(const core::MeshData& mesh) {
  std::string text = "OFF\n" + std::to_string(mesh.vertices.size()) + " " +
                     std::to_string(mesh.triangles.size()) + " 0\n";
  for (const core::Vec3d& p : mesh.vertices) {
    for (int axis = 0; axis < 3; ++axis) {
      char number[32];
      text.append(number, std::to_chars(number, number + sizeof number, p[axis]).ptr);
      text += axis < 2 ? ' ' : '\n';
    }
  }
  for (const core::TriangleIndices& t : mesh.triangles) {
    text += "3 " + std::to_string(t[0]) + " " + std::to_string(t[1]) + " " + std::to_string(t[2]) +
            "\n";
  }
  const auto* bytes = reinterpret_cast<const std::byte*>(text.data());
  return {bytes, bytes + text.size()};
}

}  // namespace kdray::test
