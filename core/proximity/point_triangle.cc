// SPDX-License-Identifier: Apache-2.0
#include "core/proximity/point_triangle.h"

#include <algorithm>

namespace kdray::core {

TriangleFoot FootOnTriangle(const Vec3d& p, const Vec3d& a, const Vec3d& b, const Vec3d& c) {
  using point_triangle::EdgeFoot;
  const point_triangle::Face face = point_triangle::FaceOf(p, a, b, c);
  TriangleFoot foot;
  if (face.IsBelow()) {
    foot.square = face.height * face.height / face.squared_normal;
    foot.point = p - face.normal * (face.height / face.squared_normal);
    foot.u = std::min(1.0, face.side_b / face.squared_normal);
    foot.v = std::min(1 - foot.u, face.side_c / face.squared_normal);
    return foot;
  }
  const Vec3d ends[3][2] = {{a, b}, {b, c}, {c, a}};
  for (int edge = 0; edge < 3; ++edge) {
    const auto& [first, second] = ends[edge];
    const EdgeFoot other = point_triangle::FootOnEdge(p, first, second);
    if (edge != 0 && !(other.square < foot.square)) continue;
    foot.square = other.square;
    const Vec3d& from = other.swapped ? second : first;
    const Vec3d& to = other.swapped ? first : second;
    // The ends themselves, without rounding.
    foot.point = other.t == 0 ? from : other.t == 1 ? to : from + (to - from) * other.t;
    const double weight = other.swapped ? 1 - other.t : other.t;  // of the edge's second corner
    foot.u = edge == 0 ? weight : edge == 1 ? 1 - weight : 0;
    foot.v = edge == 1 ? weight : edge == 2 ? 1 - weight : 0;
  }
  return foot;
}

}  // namespace kdray::core
