// SPDX-License-Identifier: Apache-2.0
// One step of a single ray: a node's eight boxes at once.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>

#include "core/accel/wide/wide_tree.h"
#include "core/kernel/simd/isa.h"
#include "core/kernel/simd/rays-inl.h"
#include "core/kernel/simd/vectors-inl.h"

KDRAY_BEGIN_ISA();
namespace kdray::core::KDRAY_ISA {

/// The ray's entries into the node's children, and the children that it meets, farthest first.
struct NodeStep {
  F8 enter;
  I8 child;
  unsigned met;
};
/// near_planes(axis) and far_planes(axis) point to the eight planes that the ray meets first and
/// last, inverse(axis) and origin_inverse(axis) are as CullRay has them.
template <class NearPlanes, class FarPlanes, class Inverse, class OriginInverse>
KDRAY_INLINE NodeStep Intersect(const WideNode& node, std::uint32_t octant,
                                const NearPlanes& near_planes, const FarPlanes& far_planes,
                                const Inverse& inverse, const OriginInverse& origin_inverse,
                                float ray_enter, float ray_exit) {
  const auto at = [&](const float* planes, int axis) KDRAY_LAMBDA {
    return MulSub(Load(planes), Set8(inverse(axis)), Set8(origin_inverse(axis)));
  };
  const F8 enter = Max(Max(at(near_planes(0), 0), at(near_planes(1), 1)),
                       Max(at(near_planes(2), 2), Set8(ray_enter)));
  const F8 exit = Min(Min(at(far_planes(0), 0), at(far_planes(1), 1)),
                      Min(at(far_planes(2), 2), Set8(ray_exit)));
  const I8 order = UnpackOrder(node.order[octant]);
  const F8 enter_in_order = Permute(enter, order);
  return {enter_in_order, Permute(Load(node.child), order),
          Bits(LessEqual(enter_in_order, Permute(exit, order)))};
}
/// The planes of a node's children at an offset of CullRay.
KDRAY_INLINE const float* PlanesAt(const WideNode& node, std::uint32_t byte) {
  return reinterpret_cast<const float*>(reinterpret_cast<const char*>(&node) + byte);
}
/// The children that the ray meets, a bit for each.
KDRAY_INLINE unsigned MetChildren(const WideNode& node, const CullRay& ray) {
  const auto at = [&](std::uint32_t byte, int axis) KDRAY_LAMBDA {
    return MulSub(Load(PlanesAt(node, byte)), Set8(ray.inverse[axis]),
                  Set8(ray.origin_inverse[axis]));
  };
  F8 enter = Set8(ray.enter), exit = Set8(ray.exit);
  for (int axis = 0; axis < 3; ++axis) {
    enter = Max(enter, at(ray.near_plane[axis], axis));
    exit = Min(exit, at(ray.far_plane[axis], axis));
  }
  return Bits(LessEqual(enter, exit));
}
KDRAY_INLINE NodeStep Intersect(const WideNode& node, const CullRay& ray) {
  const auto planes_at = [&](std::uint32_t byte) KDRAY_LAMBDA { return PlanesAt(node, byte); };
  return Intersect(
      node, ray.octant, [&](int axis) KDRAY_LAMBDA { return planes_at(ray.near_plane[axis]); },
      [&](int axis) KDRAY_LAMBDA { return planes_at(ray.far_plane[axis]); },
      [&](int axis) KDRAY_LAMBDA { return ray.inverse[axis]; },
      [&](int axis) KDRAY_LAMBDA { return ray.origin_inverse[axis]; }, ray.enter, ray.exit);
}

KDRAY_INLINE void PrefetchChild(const WideTree& tree, std::uint32_t child) {
  // Without a branch, which would be unpredictable.
  const bool is_leaf = (child & WideChild::kLeafBit) != 0;
  const char* base = is_leaf ? reinterpret_cast<const char*>(tree.blocks.data())
                             : reinterpret_cast<const char*>(tree.nodes.data());
  const std::size_t stride = is_leaf ? sizeof(LeafBlock) : sizeof(WideNode);
  const char* at = base + stride * (child & ~WideChild::kLeafBit);
  for (int line = 0; line < 4; ++line) __builtin_prefetch(at + 64 * line);
  // A block has one line more than a node.
  __builtin_prefetch(at + (is_leaf ? 256 : 0));
}

/// Whether the ray meets the box of the whole tree.
KDRAY_INLINE bool MeetsRoot(const WideTree& tree, const CullRay& ray) {
  float enter = ray.enter;
  float exit = ray.exit;
  for (int axis = 0; axis < 3; ++axis) {
    const float a = tree.bounds.min[axis] * ray.inverse[axis] - ray.origin_inverse[axis];
    const float b = tree.bounds.max[axis] * ray.inverse[axis] - ray.origin_inverse[axis];
    enter = std::max(enter, std::min(a, b));
    exit = std::min(exit, std::max(a, b));
  }
  return enter <= exit;
}

}  // namespace kdray::core::KDRAY_ISA
KDRAY_END_ISA();
