// SPDX-License-Identifier: Apache-2.0
#include "core/accel/auto_choice.h"

#include <algorithm>
#include <cstddef>
#include <vector>

#include "core/base/parallel.h"
#include "core/geometry/bounds3.h"

namespace kdray::core {

namespace {

// The triangles of a piece, which one thread takes; fixed, so the sums are the same for every
// number of threads. A piece takes less than a millisecond.
constexpr std::size_t kPiece = std::size_t{1} << 14;

struct Boxes {
  double area = 0;  // of all boxes
  Bounds3d bounds = Bounds3d::Empty();
};

}  // namespace

Result<double> BoxOverlap(const TriangleMesh& mesh, const CancelToken& cancel) {
  std::vector<Boxes> pieces((mesh.triangle_count() + kPiece - 1) / kPiece);
  mesh.VisitVertices([&](auto vertices) {
    ParallelFor(0, pieces.size(), 1, [&](std::size_t number, std::size_t) {
      if (cancel.ShouldStop()) return;
      Boxes& piece = pieces[number];
      const std::size_t end = std::min(mesh.triangle_count(), (number + 1) * kPiece);
      for (std::size_t i = number * kPiece; i < end; ++i) {
        if (mesh.IsDegenerate(static_cast<PrimitiveId>(i))) continue;
        Bounds3d box = Bounds3d::Empty();
        for (const std::uint32_t corner : mesh.triangles()[i]) box.Extend(Vec3d(vertices[corner]));
        piece.area += box.SurfaceArea();
        piece.bounds.Extend(box);
      }
    });
  });
  if (cancel.ShouldStop()) return cancel.ToError();
  Boxes all;
  for (const Boxes& piece : pieces) {
    all.area += piece.area;
    all.bounds.Extend(piece.bounds);
  }
  const double whole = all.bounds.SurfaceArea();
  return whole > 0 ? all.area / whole : 0.0;
}

}  // namespace kdray::core
