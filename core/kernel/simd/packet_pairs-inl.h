// SPDX-License-Identifier: Apache-2.0
// Pairs of a packet's rays and a block's triangles, 16 at a time, and the sides that they meet.
#pragma once

#include <cstddef>
#include <cstdint>

#include "core/accel/wide/wide_tree.h"
#include "core/geometry/hit.h"
#include "core/kernel/simd/isa.h"
#include "core/kernel/simd/vectors-inl.h"
#include "core/kernel/simd/vectors16-inl.h"

KDRAY_BEGIN_ISA();
namespace kdray::core::KDRAY_ISA {

/// [corner][axis], local coordinates.
struct Corners16 {
  F16 at[3][3];
};

/// A block's corners relative to the packet's origin, along the packet's axes.
struct CornersFromOrigin {
  F8 at[3][3];  // [corner][axis]
};

/// Pairs that may be hits (`accepted`), those of them that certainly are if their parameter lies in
/// the ray's interval, and bounds of the parameter, valid in certain lanes.
struct AlongRay {
  unsigned accepted, certain;
  F16 low, high;
};

/// The lanes in which the ray certainly meets the triangle's front, and its back; as SideMet.
struct SidesMet {
  unsigned front, back;
};
/// `d` are the directions of LocalRay in float, along the same axes as the corners; the axes must
/// be in cyclic order.
///
/// In units of 2^-24 of the sum of the sizes of its six products, d . (b x c) is off by 2 for the
/// differences b and c, 2 for the products, 1 for the difference of two, 1 for d, 1 for the product
/// with it and 2 for the sum: 9, of 16 allowed. Corners that are doubles are rounded to float by at
/// most 2^-25, which moves the result by less than 2^-21 of |b| + |c| (sums of sizes, |d| <= 2), of
/// 2^-19 allowed.
KDRAY_INLINE SidesMet FindSides(const Corners16& corners, const F16 (&d)[3], bool are_doubles) {
  F16 b[3], c[3];
  for (int k = 0; k < 3; ++k) {
    b[k] = corners.at[1][k] - corners.at[0][k];
    c[k] = corners.at[2][k] - corners.at[0][k];
  }
  F16 along = Set16(0), size = Set16(0), edges = Set16(0);
  for (int k = 0; k < 3; ++k) {
    const int i = k == 2 ? 0 : k + 1;
    const int j = i == 2 ? 0 : i + 1;
    const F16 left = b[i] * c[j], right = b[j] * c[i];
    along = along + d[k] * (left - right);
    size = size + Abs(d[k]) * (Abs(left) + Abs(right));
    edges = edges + (Abs(b[k]) + Abs(c[k]));
  }
  const F16 error =
      size * Set16(0x1p-20f) + edges * Set16(are_doubles ? 0x1p-19f : 0.0f) + Set16(0x1p-120f);
  return {Bits(Less(along, Set16(0) - error)), Bits(Less(error, along))};
}

/// Up to 16 pairs of a ray and a triangle of one block; one for each bit of `lanes`.
struct RayTrianglePairs {
  const std::uint32_t* place;  // of the ray
  const std::uint32_t* lane;   // of the triangle
  unsigned lanes;
  const LeafBlock* block;

  KDRAY_INLINE void Numbers(PrimitiveId* numbers) const {
    LookUp8(block->id, lane, numbers);
    for (int k = 0; k < 16; ++k) numbers[k] &= LeafBlock::kIdMask;
  }
  std::uint32_t slot;  // of its first triangle: its number times 8
};

/// A triangle of a block and rays at 16 places in a row, from `first` on; one for each bit of
/// `lanes`.
struct TriangleWithGroup {
  std::size_t first;
  unsigned lanes;
  const LeafBlock* block;
  std::uint32_t slot;  // of the triangle: its block's number times 8, and its lane

  KDRAY_INLINE PrimitiveId Number() const { return block->IdOf(slot % LeafBlock::kWidth); }
};
}  // namespace kdray::core::KDRAY_ISA
KDRAY_END_ISA();
