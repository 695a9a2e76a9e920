// SPDX-License-Identifier: Apache-2.0
#include "clients/cpp/sample/mesh_builder.h"

namespace kdray::client {

std::uint32_t MeshBuilder::IndexOf(const Point& point) {
  // Adding zero turns -0 into +0; otherwise a mirrored half would have different vertices on the
  // mirror plane.
  const Point key = {point[0] + 0.0, point[1] + 0.0, point[2] + 0.0};
  const auto [entry, is_new] =
      index_.try_emplace(key, static_cast<std::uint32_t>(mesh_.vertices.size()));
  if (is_new) mesh_.vertices.push_back(key);
  return entry->second;
}

void MeshBuilder::AddTriangle(const Point& a, const Point& b, const Point& c) {
  if (a == b || b == c || c == a) return;
  // Separate statements, because the order of these calls determines the file.
  const std::uint32_t ia = IndexOf(a);
  const std::uint32_t ib = IndexOf(b);
  const std::uint32_t ic = IndexOf(c);
  mesh_.triangles.push_back({ia, ib, ic});
}

void MeshBuilder::AddQuad(const Point& a, const Point& b, const Point& c, const Point& d) {
  AddTriangle(a, b, c);
  AddTriangle(a, c, d);
}

}  // namespace kdray::client
