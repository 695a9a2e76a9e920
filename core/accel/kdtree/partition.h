// SPDX-License-Identifier: Apache-2.0
// Distributes a kd-tree node's triangles to its children.
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

/// The side of a reference at a split. A triangle that ends in the plane needs no reference on the
/// other side: rays that meet it there touch the plane and visit both sides.
inline Side SideOf(const PrimitiveRef& reference, const SplitCandidate& split) {
  const unsigned below = reference.bounds.min[split.plane.axis] < split.plane.position;
  const unsigned above = reference.bounds.max[split.plane.axis] > split.plane.position;
  const unsigned planar_below = split.planar_below;
  // Otherwise it is planar.
  return static_cast<Side>((below | (planar_below & ~above)) |
                           (above | ((planar_below ^ 1u) & ~below & 1u)) << 1);
}

/// The two parts of a reference that crosses the split plane, each clipped to its child's cell; an
/// empty part has empty bounds.
ClippedHalves CutReference(const TriangleMesh& mesh, const PrimitiveRef& reference,
                           const Bounds3f& cell, const SplitPlane& plane);

struct SideCounts {
  std::size_t below = 0;
  std::size_t above = 0;
};

/// Upper bounds of the children's references: a part may be empty after clipping.
SideCounts CountSides(std::span<const PrimitiveRef> references, const SplitCandidate& split);

/// Distributes the references of `cell` to its children and clips those that the plane cuts. The
/// others come first, in their order, then the clipped ones. `below` and `above` have room for the
/// numbers that CountSides() returns, `cut` for all references. They must not overlap; only `above`
/// may be the references' own memory, which are then overwritten. Returns the numbers of references
/// in `below` and `above`.
SideCounts Distribute(const TriangleMesh& mesh, std::span<const PrimitiveRef> references,
                      const Bounds3f& cell, const SplitCandidate& split, PrimitiveRef* below,
                      PrimitiveRef* above, PrimitiveRef* cut);

/// A child's references, and the union of their bounds.
struct Share {
  PrimitiveRefArray references;
  Bounds3f bounds = Bounds3f::Empty();
};

/// The same for large nodes: in parallel, into new arrays, in an order that depends only on the
/// references. Unspecified if the monitor stops.
void DistributeInParallel(const TriangleMesh& mesh, std::span<const PrimitiveRef> references,
                          const Bounds3f& cell, const SplitCandidate& split, Share* below,
                          Share* above, BuildMonitor* monitor = nullptr);

}  // namespace kdray::core
