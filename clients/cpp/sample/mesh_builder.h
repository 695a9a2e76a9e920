// SPDX-License-Identifier: Apache-2.0
// Collects triangles and joins corners at equal positions, so neighbouring patches share vertices
// and a closed shape is closed in the file.
#pragma once

#include <map>

#include "clients/cpp/sample/sample_mesh.h"

namespace kdray::client {

class MeshBuilder {
 public:
  /// Adds a triangle; corners at exactly equal positions become one vertex. A triangle with two
  /// equal corners (at a pole of a patch) is skipped.
  void AddTriangle(const Point& a, const Point& b, const Point& c);

  /// Adds a quadrilateral with corners a b c d in order, split along the diagonal a c.
  void AddQuad(const Point& a, const Point& b, const Point& c, const Point& d);

  SampleMesh Take() && { return std::move(mesh_); }

 private:
  std::uint32_t IndexOf(const Point& point);

  std::map<Point, std::uint32_t> index_;
  SampleMesh mesh_;
};

}  // namespace kdray::client
