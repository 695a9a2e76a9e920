// SPDX-License-Identifier: Apache-2.0
// The hits of the precision `exact`: t and the weights, rounded to the nearest doubles, for several
// rays at once.
#pragma once

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "core/geometry/hit.h"
#include "core/intersect/exact_intersection.h"
#include "core/intersect/rounded_ray.h"
#include "core/kernel/kernel.h"
#include "core/kernel/simd/isa.h"
#include "core/kernel/simd/vectors-inl.h"

KDRAY_BEGIN_ISA();
namespace kdray::core::KDRAY_ISA {

// ---- Doubles, a register full of them ----

#if defined(KDRAY_ISA_AVX512)
using WideD = double __attribute__((vector_size(64)));
using WideL = std::int64_t __attribute__((vector_size(64)));
KDRAY_INLINE WideD WideProductError(WideD a, WideD b, WideD product) {
  return WideD(_mm512_fmsub_pd(__m512d(a), __m512d(b), __m512d(product)));
}
KDRAY_INLINE WideD WideMulAdd(WideD a, WideD b, WideD c) {
  return WideD(_mm512_fmadd_pd(__m512d(a), __m512d(b), __m512d(c)));
}
KDRAY_INLINE WideD WideMax(WideD a, WideD b) {
  return WideD(_mm512_max_pd(__m512d(a), __m512d(b)));
}
KDRAY_INLINE unsigned EqualLanes(WideD a, WideD b) {
  return _mm512_cmp_pd_mask(__m512d(a), __m512d(b), _CMP_EQ_OQ);
}
KDRAY_INLINE unsigned GreaterLanes(WideD a, WideD b) {
  return _mm512_cmp_pd_mask(__m512d(a), __m512d(b), _CMP_GT_OQ);
}
#else
using WideD = D4;
using WideL = L4;
KDRAY_INLINE WideD WideProductError(WideD a, WideD b, WideD product) {
  return ProductError(a, b, product);
}
KDRAY_INLINE WideD WideMulAdd(WideD a, WideD b, WideD c) { return MulAdd(a, b, c); }
KDRAY_INLINE WideD WideMax(WideD a, WideD b) { return Max(a, b); }
KDRAY_INLINE unsigned EqualLanes(WideD a, WideD b) { return Bits(L4(a == b)); }
KDRAY_INLINE unsigned GreaterLanes(WideD a, WideD b) { return Bits(L4(a > b)); }
#endif
inline constexpr unsigned kHitLanes = sizeof(WideD) / sizeof(double);

KDRAY_INLINE WideD WideSet(double x) { return x - WideD{}; }
KDRAY_INLINE WideD WideAbs(WideD v) {
  return WideD(WideL(v) & std::numeric_limits<std::int64_t>::max());
}
KDRAY_INLINE WideD WideLoad(const double* from) {
  WideD v;
  __builtin_memcpy(&v, from, sizeof(v));
  return v;
}
KDRAY_INLINE void WideStore(WideD v, double* to) { __builtin_memcpy(to, &v, sizeof(v)); }

// ---- Pairs of doubles, of which only the first has all its digits ----

/// high + low. The second double is rounded as a plain number, because it is 2^-50 of the sizes
/// that went into the first: half the operations of core/geometry/double_double.h.
struct WidePair {
  WideD high, low;
};
struct WideVector {
  WidePair at[3];

  /// The largest component's size.
  KDRAY_INLINE WideD Size() const {
    return WideMax(WideMax(WideAbs(at[0].high), WideAbs(at[1].high)), WideAbs(at[2].high));
  }
};

/// a + b exactly.
KDRAY_INLINE WidePair WideTwoSum(WideD a, WideD b) {
  const WideD sum = a + b;
  const WideD b_part = sum - a;
  return {sum, (a - (sum - b_part)) + (b - b_part)};
}
KDRAY_INLINE WidePair Product(const WidePair& a, const WidePair& b) {
  const WideD product = a.high * b.high;
  return {product,
          WideMulAdd(a.high, b.low,
                     WideMulAdd(a.low, b.high, WideProductError(a.high, b.high, product)))};
}
KDRAY_INLINE WidePair Product(const WidePair& a, WideD b) {
  const WideD product = a.high * b;
  return {product, WideMulAdd(a.low, b, WideProductError(a.high, b, product))};
}
KDRAY_INLINE WidePair Sum(const WidePair& a, const WidePair& b) {
  const WidePair sum = WideTwoSum(a.high, b.high);
  return {sum.high, sum.low + (a.low + b.low)};
}
KDRAY_INLINE WidePair Difference(const WidePair& a, const WidePair& b) {
  const WidePair difference = WideTwoSum(a.high, -b.high);
  return {difference.high, difference.low + (a.low - b.low)};
}
template <class B>  // WideVector, or the three components of a vector of plain numbers
KDRAY_INLINE WideVector Cross(const WideVector& a, const B& b) {
  WideVector product;
  for (int k = 0; k < 3; ++k) {
    const int i = k == 2 ? 0 : k + 1;
    const int j = i == 2 ? 0 : i + 1;
    product.at[k] = Difference(Product(a.at[i], b.at[j]), Product(a.at[j], b.at[i]));
  }
  return product;
}
/// With the second double no larger than the rounding of the first.
template <class B>
KDRAY_INLINE WidePair Dot(const WideVector& a, const B& b) {
  const WidePair sum =
      Sum(Sum(Product(a.at[0], b.at[0]), Product(a.at[1], b.at[1])), Product(a.at[2], b.at[2]));
  return WideTwoSum(sum.high, sum.low);
}
struct PlainVector {
  WideD at[3];

  KDRAY_INLINE WideD Size() const {
    return WideMax(WideMax(WideAbs(at[0]), WideAbs(at[1])), WideAbs(at[2]));
  }
};

/// A number and a bound on its error.
struct BoundedPair {
  WidePair value;
  WideD error;
};
/// `inverse` is that of the denominator's first double.
///
/// The quotient's own error is below 2^-100 of it. The denominator's bound is at least 2^-99 of the
/// denominator, and counts here twice where it would count 4/3 times, since it is a quarter of the
/// denominator at most (SolveTogether).
KDRAY_INLINE BoundedPair Ratio(const BoundedPair& numerator, const BoundedPair& denominator,
                               WideD inverse) {
  const WideD first = numerator.value.high * inverse;
  const WideD product = first * denominator.value.high;
  // The first difference is exact.
  const WideD rest = ((numerator.value.high - product) -
                      WideProductError(first, denominator.value.high, product)) +
                     (numerator.value.low - first * denominator.value.low);
  const WideD second = rest * inverse;
  const WideD high = first + second;
  return {{high, second - (high - first)},
          WideSet(2) * (numerator.error + WideAbs(high) * denominator.error) * WideAbs(inverse)};
}
/// Returns the lanes whose bound leaves only one nearest double.
KDRAY_INLINE unsigned RoundTogether(const BoundedPair& x, WideD* rounded) {
  *rounded = x.value.high + (x.value.low - x.error);
  return EqualLanes(*rounded, x.value.high + (x.value.low + x.error));
}
/// RoundsToWeight, lane by lane.
KDRAY_INLINE unsigned RoundWeights(const BoundedPair& x, double* rounded) {
  const WideD small = WideSet(kSmallWeight);
  const WideD added = WideD(WideL(x.value.high < small) & WideL(small));
  const WidePair sum = WideTwoSum(added, x.value.high);
  WideD weight;
  const unsigned known =
      RoundTogether({{sum.high, sum.low + x.value.low}, x.error + WideSet(0x1p-110)}, &weight);
  WideStore(weight - added, rounded);
  return known;
}

// ---- The hits ----

/// Rays, each with the triangle that it hits; in local coordinates.
struct ExactHits {
  alignas(64) double direction[3][kHitLanes];
  alignas(64) double origin[3][kHitLanes], origin_low[3][kHitLanes], origin_size[kHitLanes];
  alignas(64) double shift[kHitLanes], shift_low[kHitLanes];
  alignas(64) double corner[3][3][kHitLanes];  // of corner a, b, c the coordinates x, y, z

  void SetRay(unsigned k, const RoundedRay& ray) {
    for (int axis = 0; axis < 3; ++axis) {
      direction[axis][k] = ray.direction[axis];
      origin[axis][k] = ray.origin[axis];
      origin_low[axis][k] = ray.origin_low[axis];
    }
    // What the origin's second double, and its error, add to the size of `g` in SolveTogether.
    origin_size[k] = 0x1p53 * ray.origin_rounding + 4 * ray.OriginSize();
    shift[k] = ray.shift;
    shift_low[k] = ray.shift_low;
  }
  /// The same ray in all lanes.
  void SetRay(const RoundedRay& ray) {
    for (unsigned k = 0; k < kHitLanes; ++k) SetRay(k, ray);
  }
  template <class Number>
  void SetCorner(unsigned k, int which, const Vec3<Number>& at) {
    for (int axis = 0; axis < 3; ++axis) {
      corner[which][axis][k] = static_cast<double>(at[axis]);
    }
  }
};

/// The numbers of RoundedRay::Solve, with the names there, rounded to what is answered. Returns the
/// lanes that need no more digits; t counts lengths of the local direction.
///
/// The error of each volume, with u = 2^-53 and E, F, G, D the sizes of e, f, g, d. The second
/// doubles of e and f are exact, below u E and u F; that of g is below u (G + |origin_low| / u) and
/// off by u times that. A component of f x d has a second double below 7 u F D, off by 16 u^2 F D;
/// one of e x g below 9 u E G, off by 32 u^2 E G, each with G as above. In a sum of three products
/// with them the second doubles stay below 47 u, and the error below 400 u^2 < 2^-97, times the
/// three sizes; fused or not. kCoarseStep is twice that. The origin's own error, which origin_size
/// has 2^99 times, enters at most six times.
KDRAY_INLINE unsigned SolveTogether(const ExactHits& hits, double* t, double* u, double* v) {
  constexpr double kCoarseStep = 2 * RoundedRay::kStep;
  const WideD step = WideSet(kCoarseStep), underflow = WideSet(RoundedRay::kUnderflow);
  PlainVector d;
  WideVector e, f, g;
  for (int k = 0; k < 3; ++k) {
    const WideD a = WideLoad(hits.corner[0][k]);
    d.at[k] = WideLoad(hits.direction[k]);
    e.at[k] = WideTwoSum(WideLoad(hits.corner[1][k]), -a);
    f.at[k] = WideTwoSum(WideLoad(hits.corner[2][k]), -a);
    g.at[k] = WideTwoSum(WideLoad(hits.origin[k]), -a);
    g.at[k].low += WideLoad(hits.origin_low[k]);
  }
  const WideD size_e = e.Size(), size_fd = f.Size() * d.Size();
  const WideD size_eg = size_e * (g.Size() + WideLoad(hits.origin_size));
  const WideVector fd = Cross(f, d), eg = Cross(e, g);

  const BoundedPair sum = {Dot(e, fd), WideMulAdd(step, size_e * size_fd, underflow)};
  const WideD least = WideAbs(sum.value.high);
  unsigned known = GreaterLanes(least, WideSet(RoundedRay::kLeastDenominator)) &
                   GreaterLanes(least, WideSet(4) * sum.error);
  const WideD inverse = WideSet(1) / sum.value.high;

  BoundedPair s =
      Ratio({Dot(f, eg), WideMulAdd(step, f.Size() * size_eg, underflow)}, sum, inverse);
  const WideD shift = WideLoad(hits.shift);
  // RoundedRay::Along.
  const WidePair moved = WideTwoSum(shift, s.value.high);
  const WideD low = WideLoad(hits.shift_low) + s.value.low;
  s.value = WideTwoSum(moved.high, moved.low + low);
  s.error = WideMulAdd(WideSet(0x1p-100), WideAbs(shift) + WideAbs(s.value.high), s.error);
  WideD along;
  known &= RoundTogether(s, &along);
  WideStore(along, t);

  const WideD size_g = g.Size() + WideLoad(hits.origin_size);
  known &= RoundWeights(
      Ratio({Dot(g, fd), WideMulAdd(step, size_g * size_fd, underflow)}, sum, inverse), u);
  known &= RoundWeights(
      Ratio({Dot(eg, d), WideMulAdd(step, d.Size() * size_eg, underflow)}, sum, inverse), v);
  return known;
}

/// Whether scaling to the caller's t rounded nothing: true except for numbers below the normal
/// range.
KDRAY_INLINE bool IsRoundedOnce(double caller_t) {
  return std::fabs(caller_t) >= std::numeric_limits<double>::min();
}

// ---- Answers ----

/// Collects the hits of ended searches and writes them together. Flush() writes the rest.
class ExactAnswers {
 public:
  template <class Search>
  KDRAY_INLINE void Add(const KernelJob& job, const Search& search) {
    if (!search.found || search.is_scalar) {
      job.hits[search.row] = search.found ? job.scalar->Finish(search.space) : Hit{};
      return;
    }
    hits_.SetRay(size_, search.exact);
    for (int corner = 0; corner < 3; ++corner) {
      hits_.SetCorner(size_, corner, search.BestCorner(job, corner));
    }
    exponent_[size_] = search.exponent;
    row_[size_] = search.row;
    id_[size_] = search.best_id;
    if (++size_ == kHitLanes) Flush(job);
  }

  void Flush(const KernelJob& job) {
    if (size_ == 0) return;
    alignas(64) double t[kHitLanes], u[kHitLanes], v[kHitLanes];
    const unsigned known = SolveTogether(hits_, t, u, v);
    for (unsigned k = 0; k < size_; ++k) {
      const double caller_t = ToCallerT(t[k], exponent_[k]);
      job.hits[row_[k]] = (known >> k & 1u) != 0 && IsRoundedOnce(caller_t)
                              ? Hit{caller_t, u[k], v[k], id_[k]}
                              : DecidedByScalar(job, row_[k], id_[k]);
    }
    size_ = 0;
  }

 private:
  __attribute__((noinline)) static Hit DecidedByScalar(const KernelJob& job, std::size_t row,
                                                       PrimitiveId id) {
    ScalarSearchSpace space;
    const Ray ray = job.rays[row];
    job.scalar->Begin(*job.scalar->MakeRay(ray, job.mesh->frame()), &space);
    return job.scalar->Answer(id, &space);
  }

  ExactHits hits_ = {};
  int exponent_[kHitLanes] = {};
  std::size_t row_[kHitLanes] = {};
  PrimitiveId id_[kHitLanes] = {};
  unsigned size_ = 0;
};

}  // namespace kdray::core::KDRAY_ISA
KDRAY_END_ISA();
