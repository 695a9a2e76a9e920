// SPDX-License-Identifier: Apache-2.0
// Distances of a point and triangles in real numbers: their order, and the answer that is rounded
// once. The last resort of the precision `exact`.
#pragma once

#include <array>
#include <optional>

#include "core/geometry/triangle_mesh.h"
#include "core/geometry/vec3.h"

namespace kdray::core {

/// The corners of a triangle in the mesh's frame.
using TriangleCorners = std::array<Vec3d, 3>;

/// The exact answer, each number rounded to the nearest double. A distance beyond the range of
/// double is the largest finite one.
struct ExactFoot {
  double distance = 0;  ///< world units
  Vec3d point;          ///< world
  double u = 0, v = 0;  ///< weights of the second and third corner
};

/// A query point as given. Immutable, so safe from many threads at once.
class ExactPoint {
 public:
  /// `world` must be finite; `frame` must outlive this.
  ExactPoint(const Vec3d& world, const MeshFrame& frame);

  /// -1, 0 or 1: whether the distance to the closed triangle `a` is less than, equal to or greater
  /// than that to `b`. Neither may be degenerate. A filter in double recognises that both triangles
  /// share the corner or edge that is closest; integers decide the rest, in some microseconds.
  int Compare(const TriangleCorners& a, const TriangleCorners& b) const;
  /// Whether the point lies on the closed triangle.
  bool IsOn(const TriangleCorners& triangle) const;
  ExactFoot FootOn(const TriangleCorners& triangle) const;

 private:
  /// The corner that is closest, or both ends of the edge: equal for triangles that share it.
  /// nullopt if double cannot tell, or it is the face.
  struct SharedPart {
    Vec3d first, second;
    friend bool operator==(const SharedPart&, const SharedPart&) = default;
  };
  std::optional<SharedPart> CertainPart(const TriangleCorners& triangle) const;

  Vec3d world_;
  const MeshFrame* frame_;
  Vec3d local_;   // rounded
  bool is_near_;  // local_ is within some mesh sizes, so the filter may use it
};

}  // namespace kdray::core
