// Collects triangles and joins corners at the same place, so that neighbouring patches share their
// vertices and a closed shape is closed in the file too.
#pragma once

#include <map>

#include "clients/cpp/sample/sample_mesh.h"

namespace kdray::client {

class MeshBuilder {
 public:
  /// Adds a triangle; corners at exactly equal positions become one vertex. A triangle with two
  /// equal corners (a patch that runs into a pole) is left out.
  void AddTriangle(const Point& a, const Point& b, const Point& c);

  /// A quadrilateral a b c d in order around its rim, cut along the diagonal a c.
  void AddQuad(const Point& a, const Point& b, const Point& c, const Point& d);

  SampleMesh Take() && { return std::move(mesh_); }

 private:
  std::uint32_t IndexOf(const Point& point);

  std::map<Point, std::uint32_t> index_;
  SampleMesh mesh_;
};

}  // namespace kdray::client
