// Hands a kd-tree node's triangles to its children.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "core/accel/kdtree/split.h"
#include "core/accel/primitive_ref.h"
#include "core/geometry/bounds3.h"
#include "core/geometry/clip.h"
#include "core/geometry/triangle_mesh.h"

namespace kdray::core {

enum class Side : unsigned char { kBelow = 1, kAbove = 2, kBoth = 3 };

/// Where a reference goes at a cut. A triangle that ends in the plane needs no reference on the
/// other side: the rays that meet it there touch the plane and visit both.
inline Side SideOf(const PrimitiveRef& reference, const SplitCandidate& split) {
  const unsigned below = reference.bounds.min[split.plane.axis] < split.plane.position;
  const unsigned above = reference.bounds.max[split.plane.axis] > split.plane.position;
  const unsigned planar_below = split.planar_below;
  // Where it is neither it is planar.
  return static_cast<Side>((below | (planar_below & ~above)) |
                           (above | ((planar_below ^ 1u) & ~below & 1u)) << 1);
}

/// The two parts of a reference that a cut goes through, each clipped to its child's cell; a part
/// without a point has empty bounds.
ClippedHalves CutReference(const TriangleMesh& mesh, const PrimitiveRef& reference,
                           const Bounds3f& cell, const SplitPlane& plane);

struct SideCounts {
  std::size_t below = 0;
  std::size_t above = 0;
};

/// How many references the children can get at most: a part may turn out empty when it is clipped.
SideCounts CountSides(std::span<const PrimitiveRef> references, const SplitCandidate& split);

/// Hands the references of `cell` to its children and clips those that the plane cuts: first the
/// others in their order, then these. `below` and `above` have room for as many as CountSides()
/// says, `cut` for all; they overlap nothing, but `above` may also be where the references are,
/// which are then gone. The result says how much of `below` and `above` was used.
SideCounts Distribute(const TriangleMesh& mesh, std::span<const PrimitiveRef> references,
                      const Bounds3f& cell, const SplitCandidate& split, PrimitiveRef* below,
                      PrimitiveRef* above, PrimitiveRef* cut);

/// A child's references, and the union of their bounds.
struct Share {
  PrimitiveRefArray references;
  Bounds3f bounds = Bounds3f::Empty();
};

/// The same for large nodes: in parallel, into arrays of its own, in an order that depends on the
/// references alone. Anything once the monitor says stop.
void DistributeInParallel(const TriangleMesh& mesh, std::span<const PrimitiveRef> references,
                          const Bounds3f& cell, const SplitCandidate& split, Share* below,
                          Share* above, BuildMonitor* monitor = nullptr);

}  // namespace kdray::core
