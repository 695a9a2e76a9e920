// SPDX-License-Identifier: Apache-2.0
// The simplest structure: one bounding box, then every triangle (George Tang, "Acceleration
// Structures", 2019, section 1). `auto` uses it for tiny meshes.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/accel/tree_cell.h"
#include "core/base/cancel.h"
#include "core/geometry/bounds3.h"
#include "core/geometry/hit.h"
#include "core/geometry/local_ray.h"

namespace kdray::core {

/// Immutable once built; safe from many threads at once. Coordinates are the mesh's local ones.
struct BoxList {
  Bounds3f bounds = Bounds3f::Empty();  ///< of the triangles, rounded outward
  std::vector<PrimitiveId> primitives;  ///< every triangle that is not degenerate, ascending

  std::uint64_t bytes() const { return primitives.size() * sizeof(PrimitiveId); }

  /// As KdTree::Traverse, with one leaf.
  template <class Visit, class OnNode>
  void Traverse(const LocalRay& ray, double pad, const Visit& visit, const OnNode& on_node) const {
    if (!on_node()) return;
    if (ClipToBox(ray, Bounds3d{Vec3d(bounds.min), Vec3d(bounds.max)}, pad, SearchInterval(ray))
            .IsEmpty())
      return;
    visit(std::span<const PrimitiveId>(primitives));
  }

  /// As KdTree::Cells.
  Result<std::vector<TreeCell>> Cells(std::uint32_t depth, std::size_t limit,
                                      const CancelToken& cancel = {}) const;
};

}  // namespace kdray::core
