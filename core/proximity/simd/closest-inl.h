// SPDX-License-Identifier: Apache-2.0
// The walk of a wide tree to a point's closest triangle: eight boxes, and eight triangles, at once.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>

#include "core/accel/wide/wide_tree.h"
#include "core/kernel/simd/isa.h"
#include "core/kernel/simd/vectors-inl.h"
#include "core/proximity/closest_kernel.h"
#include "core/proximity/point_search.h"

KDRAY_BEGIN_ISA();
namespace kdray::core::KDRAY_ISA {

/// A point for culling in float.
///
/// Boxes are larger than what is in them by kWidePad on each side. The point's rounding, and that
/// of its difference from a box, are below 2^-23 (size + 1) together; the rest of the pad is taken
/// off again by moving the point to both sides by `back`.
///
/// The corners of a block are off by 2^-25 and the point by 2^-24 size; a squared distance from
/// them has 8 roundings of lengths below 3 (size + 3). So a filter's distance is below that to the
/// triangle plus `slack`.
struct CullPoint {
  float at[3], before[3], behind[3];
  float slack;

  KDRAY_INLINE explicit CullPoint(const SearchPoint& point) {
    const double back = kWidePad - 0x1p-22 * (point.size + 1);
    for (int axis = 0; axis < 3; ++axis) {
      const double x = point.at[axis];
      at[axis] = static_cast<float>(x);
      before[axis] = static_cast<float>(x - back);
      behind[axis] = static_cast<float>(x + back);
    }
    slack = static_cast<float>(0x1p-20 * (2 * point.size + 6));
  }
};

/// What is farther cannot win: squared distances to boxes, and of the filter.
struct CullLimit {
  float box, triangle;

  KDRAY_INLINE CullLimit(double distance, float slack) {
    constexpr float kMost = std::numeric_limits<float>::max();
    constexpr float kRound = 1 + 0x1p-19f;
    if (!(distance < 0x1p60)) {
      box = triangle = kMost;
      return;
    }
    const float up = static_cast<float>(distance) * kRound;
    box = up * up * kRound;
    triangle = (up + slack) * (up + slack) * kRound;
  }
};

/// Lower bounds of the squared distances to a node's boxes; infinite for empty places.
KDRAY_INLINE F8 SquaredDistances(const CullPoint& point, const WideNode& node) {
  F8 sum = Set8(0);
  for (int axis = 0; axis < 3; ++axis) {
    const F8 below = Load(node.low[axis]) - Set8(point.before[axis]);
    const F8 above = Set8(point.behind[axis]) - Load(node.high[axis]);
    const F8 d = Max(Max(below, above), Set8(0));
    sum = MulAdd(d, d, sum);
  }
  return sum;
}

/// `a` in the lanes of the mask, `b` in the others.
KDRAY_INLINE F8 Blend(M8 mask, F8 a, F8 b) {
#if defined(KDRAY_ISA_AVX512)
  return F8(_mm256_mask_blend_ps(mask.bits, __m256(b), __m256(a)));
#else
  return mask.lanes ? a : b;
#endif
}

struct Vector8 {
  F8 x, y, z;
};
KDRAY_INLINE Vector8 operator-(const Vector8& a, const Vector8& b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}
KDRAY_INLINE F8 Dot8(const Vector8& a, const Vector8& b) {
  return MulAdd(a.x, b.x, MulAdd(a.y, b.y, a.z * b.z));
}
KDRAY_INLINE Vector8 Cross8(const Vector8& a, const Vector8& b) {
  return {MulSub(a.y, b.z, a.z * b.y), MulSub(a.z, b.x, a.x * b.z), MulSub(a.x, b.y, a.y * b.x)};
}
/// The sum of the sizes of the components.
KDRAY_INLINE F8 Size8(const Vector8& a) { return Abs(a.x) + Abs(a.y) + Abs(a.z); }

/// Squares below it vanish beside the slack of the filter.
inline constexpr float kTinySquare = 0x1p-100f;

/// Of the segment from 0 along `edge`; `at` is the point. Any t in [0, 1] belongs to a point of the
/// segment, so the result is too large by the error of t alone.
KDRAY_INLINE F8 SquaredDistanceToEdge(const Vector8& at, const Vector8& edge) {
  const F8 length = Max(Dot8(edge, edge), Set8(kTinySquare));
  const F8 t = Min(Max(Dot8(at, edge) / length, Set8(0)), Set8(1));
  const Vector8 across = {NegMulAdd(t, edge.x, at.x), NegMulAdd(t, edge.y, at.y),
                          NegMulAdd(t, edge.z, at.z)};
  return Dot8(across, across);
}

/// Lower bounds, except for CullPoint::slack, of the squared distances to a block's triangles; NaN
/// in lanes without one.
///
/// With edges b and c from corner a, n = b x c and q = point - a, the sides are v = q.(n x b) and u
/// = q.(c x n). Below, |b| is the sum of the sizes of b's components. n is off by less than 2^-21.6
/// |b||c|, so u, v and q.n are by less than kRoom |q||b||c| times |c|, |b| and 1. Where all sides
/// may be inside, the distance to the plane counts too: needles, whose normal float cannot resolve,
/// get a small one.
KDRAY_INLINE F8 SquaredDistances(const CullPoint& point, const LeafBlock& block) {
  constexpr float kRoom = 0x1p-20f;
  const auto corner = [&](int k) KDRAY_LAMBDA {
    return Vector8{Load(block.corner[k][0]), Load(block.corner[k][1]), Load(block.corner[k][2])};
  };
  const Vector8 a = corner(0);
  const Vector8 b = corner(1) - a, c = corner(2) - a;
  const Vector8 q = Vector8{Set8(point.at[0]), Set8(point.at[1]), Set8(point.at[2])} - a;
  const F8 edges = Min(Min(SquaredDistanceToEdge(q, b), SquaredDistanceToEdge(q, c)),
                       SquaredDistanceToEdge(q - b, c - b));

  const Vector8 n = Cross8(b, c);
  const F8 square = Dot8(n, n);
  const F8 u = Dot8(q, Cross8(c, n)), v = Dot8(q, Cross8(n, b));
  const F8 size_b = Size8(b), size_c = Size8(c);
  const F8 size_n = size_b * size_c;
  const F8 room = size_n * Size8(q) * Set8(kRoom);
  const F8 zero = Set8(0);
  const F8 room_n = size_n * size_n * Set8(kRoom);
  const M8 inside = LessEqual(zero, u + room * size_c) & LessEqual(zero, v + room * size_b) &
                    LessEqual(u + v, square + room * (size_b + size_c) + room_n);
  const F8 height = Max(Abs(Dot8(n, q)) - room, zero);
  const F8 plane = height * height / (square + room_n + Set8(kTinySquare));
  return Blend(inside, Min(plane, edges), edges);
}

/// Offers the judge every triangle that may win.
template <class Judge>
void WalkToPoint(const PointJob& job, const SearchPoint& point, Judge* judge) {
  const WideTree& tree = *job.tree;
  if (tree.root == WideChild::kEmpty) return;
  const CullPoint cull(point);
  CullLimit limit(judge->Limit(), cull.slack);
  PointStackEntry* const stack = job.stack.data();
  std::size_t size = 0;
  std::uint32_t child = tree.root;
  for (;;) {
    if ((child & WideChild::kLeafBit) == 0) {
      if (job.poll->Spend(kPointNodeWork)) return;
      const WideNode& node = tree.nodes[child];
      const F8 squares = SquaredDistances(cull, node);
      unsigned near = Bits(LessEqual(squares, Set8(limit.box)));
      alignas(32) float square[8];
      Store(squares, square);
      // Sorted by insertion; the nearest comes last.
      const std::size_t begin = size;
      for (; near != 0; near &= near - 1) {
        const auto lane = static_cast<unsigned>(__builtin_ctz(near));
        std::size_t place = size++;
        for (; place > begin && stack[place - 1].square < square[lane]; --place) {
          stack[place] = stack[place - 1];
        }
        stack[place] = {square[lane], node.child[lane]};
        const std::uint32_t next = node.child[lane];
        const bool is_leaf = (next & WideChild::kLeafBit) != 0;
        const char* data =
            is_leaf ? reinterpret_cast<const char*>(tree.blocks.data()) +
                          sizeof(LeafBlock) * (next & ~WideChild::kLeafBit)
                    : reinterpret_cast<const char*>(tree.nodes.data()) + sizeof(WideNode) * next;
        for (int line = 0; line < 4; ++line) __builtin_prefetch(data + 64 * line);
      }
    } else {
      for (std::size_t b = child & ~WideChild::kLeafBit;; ++b) {
        if (job.poll->Spend(kPointBlockWork)) return;
        const LeafBlock& block = tree.blocks[b];
        const F8 squares = SquaredDistances(cull, block);
        unsigned near = Bits(LessEqual(squares, Set8(limit.triangle)));
        if (near != 0) {
          alignas(32) float square[8];
          Store(squares, square);
          while (near != 0) {
            auto lane = static_cast<unsigned>(__builtin_ctz(near));
            for (unsigned rest = near & (near - 1); rest != 0; rest &= rest - 1) {
              const auto other = static_cast<unsigned>(__builtin_ctz(rest));
              if (square[other] < square[lane]) lane = other;
            }
            near &= ~(1u << lane);
            if (judge->Offer(block.IdOf(lane), job.poll)) {
              limit = CullLimit(judge->Limit(), cull.slack);
              near &= Bits(LessEqual(squares, Set8(limit.triangle)));
            }
          }
        }
        if (block.IsLast()) break;
      }
    }
    do {
      if (size == 0) return;
      --size;
    } while (stack[size].square > limit.box);
    child = stack[size].child;
  }
}

template <class Stored>
void FindClosest(const PointJob& job, std::span<const SearchPoint> points,
                 std::span<PrimitiveId> closest) {
  DoubleJudge<Stored> judge(job.mesh->vertices<Stored>(), job.mesh->triangles());
  PrimitiveId candidate = kNoPrimitive;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (job.poll->Spend(kPointWork)) return;
    judge.Begin(points[i]);
    if (candidate != kNoPrimitive) judge.Offer(candidate, job.poll);
    WalkToPoint(job, points[i], &judge);
    closest[i] = candidate = judge.id();
  }
}

// One source file for each instruction set includes this one.
// NOLINTBEGIN(misc-definitions-in-headers)
void FindClosestExactly(const PointJob& job, const SearchPoint& point, ExactJudge* judge) {
  WalkToPoint(job, point, judge);
}

PointKernels FindForPoints(bool double_vertices) {
  return {double_vertices ? &FindClosest<double> : &FindClosest<float>, &FindClosestExactly};
}
// NOLINTEND(misc-definitions-in-headers)

}  // namespace kdray::core::KDRAY_ISA
KDRAY_END_ISA();
