// SPDX-License-Identifier: Apache-2.0
// Filters in float for a block's eight triangles; they never drop a triangle that the triangle
// intersection accepts.
#pragma once

#include <cstdint>

#include "core/accel/wide/wide_tree.h"
#include "core/geometry/local_ray.h"
#include "core/intersect/triangle_intersection.h"
#include "core/kernel/simd/isa.h"
#include "core/kernel/simd/rays-inl.h"
#include "core/kernel/simd/vectors-inl.h"

KDRAY_BEGIN_ISA();
namespace kdray::core::KDRAY_ISA {

/// A block's corners in a ray's coordinates, where the ray runs along the third axis through (0,
/// 0): the same operations as WatertightIntersection<float>::Project.
struct ProjectedBlock {
  F8 x[3], y[3], z[3];
};
KDRAY_INLINE ProjectedBlock Project(const CullRay& ray, const LeafBlock& block) {
  ProjectedBlock p;
  const std::uint32_t kx = ray.axis[0], ky = ray.axis[1], kz = ray.axis[2];
  const F8 ox = Set8(ray.origin[kx]), oy = Set8(ray.origin[ky]), oz = Set8(ray.origin[kz]);
  const F8 sx = Set8(ray.shear[0]), sy = Set8(ray.shear[1]);
  for (int corner = 0; corner < 3; ++corner) {
    const auto& at = block.corner[corner];
    p.z[corner] = Load(at[kz]) - oz;
    p.x[corner] = (Load(at[kx]) - ox) - sx * p.z[corner];
    p.y[corner] = (Load(at[ky]) - oy) - sy * p.z[corner];
  }
  return p;
}

/// Signed areas opposite each corner, as WatertightIntersection<float> computes them.
struct EdgeFunctions {
  F8 a, b, c;

  /// Exactly the triangles that WatertightIntersection<float> accepts, and those that it decides by
  /// exact signs because one of the three is 0. Not those with NaN corners.
  KDRAY_INLINE unsigned OneSign() const {
    const F8 zero = Set8(0);
    return Bits(LessEqual(zero, Min(Min(a, b), c)) | LessEqual(Max(Max(a, b), c), zero));
  }
};
KDRAY_INLINE EdgeFunctions EdgesOf(const ProjectedBlock& p) {
  return {p.x[2] * p.y[1] - p.y[2] * p.x[1], p.x[0] * p.y[2] - p.y[0] * p.x[2],
          p.x[1] * p.y[0] - p.y[1] * p.x[0]};
}

/// What any test may accept that decides on corners within 2^-25 of the block's and is off by less
/// than kDoublePad. A projected coordinate here is off by less than 64 * 2^-24 =: d (origin, corner
/// and shear rounded, three roundings of numbers up to 10); so with coordinates up to m an edge
/// function is off by less than 4 d m + 2 d^2 and its own rounding, 2^-22 m^2 <= 2^-18 m.
KDRAY_INLINE unsigned FilterRelaxed(const CullRay& ray, const LeafBlock& block) {
  const ProjectedBlock p = Project(ray, block);
  const EdgeFunctions w = EdgesOf(p);
  const F8 m = Max(Max(Max(Abs(p.x[0]), Abs(p.y[0])), Max(Abs(p.x[1]), Abs(p.y[1]))),
                   Max(Abs(p.x[2]), Abs(p.y[2])));
  const F8 slack = m * Set8(0x1p-15f) + Set8(0x1p-34f);
  const F8 zero = Set8(0);
  return Bits(LessEqual(zero, Min(Min(w.a, w.b), w.c) + slack) |
              LessEqual(Max(Max(w.a, w.b), w.c) - slack, zero));
}

/// A block's triangles, prepared for many rays: a filter that never drops a triangle that the
/// triangle intersection accepts.
///
/// With edges b and c from corner a, n = b x c, a ray from o along d, f = o - a, and w = f x d, the
/// ray meets the plane at s = f.n / D, where u = c.w / D, v = -b.w / D, and D = -d.n (Moeller and
/// Trumbore 1997). Below, |b| is the sum of the sizes of b's components.
///
/// Every leaf test accepts only where the ray, at its s, is within kFloatPad of a point of the
/// triangle. Rounding origin, direction and corners to float moves the two by less than 2^-19 from
/// each other; so f is off by less than pad = kFloatPad + 2^-19 from what the formulas ask for, c.w
/// and -b.w from u D and v D by less than 4 pad |c| and 4 pad |b|, and f.n from s D by less than
/// pad |n|. Rounding here, where |f| <= 5, |d| <= 2, |s| <= 6 and |b|, |c| <= 6, adds less than
/// 2^-16.7 |c| and 2^-16.7 |b|, and 2^-17.3 |b| |c|; below the normal range, less than 2^-140.
struct BlockFilter {
  F8 a[3], b[3], c[3], n[3];
  F8 slack_uv, slack_s;

  KDRAY_INLINE explicit BlockFilter(const LeafBlock& block) {
    F8 size_b = Set8(0), size_c = Set8(0), size_n = Set8(0);
    for (int k = 0; k < 3; ++k) {
      a[k] = Load(block.corner[0][k]);
      b[k] = Load(block.corner[1][k]) - a[k];
      c[k] = Load(block.corner[2][k]) - a[k];
      size_b = size_b + Abs(b[k]);
      size_c = size_c + Abs(c[k]);
    }
    for (int k = 0; k < 3; ++k) {
      const int p = (k + 1) % 3, q = (k + 2) % 3;
      n[k] = b[p] * c[q] - b[q] * c[p];
      size_n = size_n + Abs(n[k]);
    }
    constexpr float kPad = static_cast<float>(kFloatPad + 0x1p-19);
    const F8 underflow = Set8(0x1p-140f);
    slack_uv = (size_b + size_c) * Set8(0x1p-14f) + underflow;
    slack_s = size_n * Set8(kPad) + size_b * size_c * Set8(0x1p-17f) + underflow;
  }

  /// The lanes that a ray may hit between `enter` and `exit`, which are finite. Not those with NaN
  /// corners.
  KDRAY_INLINE unsigned Lanes(const float (&origin)[3], const float (&direction)[3], float enter,
                              float exit) const {
    const F8 fx = Set8(origin[0]) - a[0], fy = Set8(origin[1]) - a[1], fz = Set8(origin[2]) - a[2];
    const F8 dx = Set8(direction[0]), dy = Set8(direction[1]), dz = Set8(direction[2]);
    const F8 wx = MulSub(fy, dz, fz * dy);
    const F8 wy = MulSub(fz, dx, fx * dz);
    const F8 wz = MulSub(fx, dy, fy * dx);
    const F8 along = MulAdd(dx, n[0], MulAdd(dy, n[1], dz * n[2]));
    const F8 size = Abs(along);
    // All three times the sign of -D; its absolute value is the divisor.
    const I8 sign = I8(along) & SetI8(0x80000000u);
    const auto turned = [&](F8 x) KDRAY_LAMBDA { return F8(I8(x) ^ sign); };
    const F8 minus_u = turned(MulAdd(c[0], wx, MulAdd(c[1], wy, c[2] * wz)));
    const F8 v = turned(MulAdd(b[0], wx, MulAdd(b[1], wy, b[2] * wz)));
    const F8 minus_s = turned(MulAdd(fx, n[0], MulAdd(fy, n[1], fz * n[2])));
    return Bits(LessEqual(Max(minus_u, -v), slack_uv) & LessEqual(v - minus_u, size + slack_uv) &
                (LessEqual(minus_s, NegMulAdd(Set8(enter), size, slack_s)) &
                 LessEqual(NegMulAdd(Set8(exit), size, -slack_s), minus_s)));
  }
};

}  // namespace kdray::core::KDRAY_ISA
KDRAY_END_ISA();
