// The hits of the precision `exact`: RoundedRay's t and weights for four rays at once.
#pragma once

#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "core/geometry/hit.h"
#include "core/intersect/exact_intersection.h"
#include "core/intersect/rounded_ray.h"
#include "core/kernel/kernel.h"
#include "core/kernel/simd/isa.h"
#include "core/kernel/simd/vectors-inl.h"

KDRAY_BEGIN_ISA();
namespace kdray::core::KDRAY_ISA {

// ---- core/geometry/double_double.h, lane by lane ----

struct DoubleDouble4 {
  D4 high, low;
};

KDRAY_INLINE DoubleDouble4 TwoSum4(D4 a, D4 b) {
  const D4 sum = a + b;
  const D4 b_part = sum - a;
  return {sum, (a - (sum - b_part)) + (b - b_part)};
}
KDRAY_INLINE DoubleDouble4 TwoDifference4(D4 a, D4 b) { return TwoSum4(a, -b); }
KDRAY_INLINE DoubleDouble4 FastTwoSum4(D4 a, D4 b) {
  const D4 sum = a + b;
  return {sum, b - (sum - a)};
}
KDRAY_INLINE DoubleDouble4 operator+(const DoubleDouble4& a, const DoubleDouble4& b) {
  const DoubleDouble4 high = TwoSum4(a.high, b.high);
  const DoubleDouble4 low = TwoSum4(a.low, b.low);
  const DoubleDouble4 sum = FastTwoSum4(high.high, high.low + low.high);
  return FastTwoSum4(sum.high, sum.low + low.low);
}
KDRAY_INLINE DoubleDouble4 operator-(const DoubleDouble4& a, const DoubleDouble4& b) {
  return a + DoubleDouble4{-b.high, -b.low};
}
KDRAY_INLINE DoubleDouble4 operator*(const DoubleDouble4& a, const DoubleDouble4& b) {
  const D4 product = a.high * b.high;
  return FastTwoSum4(product,
                     ProductError(a.high, b.high, product) + (a.high * b.low + a.low * b.high));
}
KDRAY_INLINE DoubleDouble4 operator/(const DoubleDouble4& a, const DoubleDouble4& b) {
  const D4 first = a.high / b.high;
  const DoubleDouble4 rest = a - b * DoubleDouble4{first, Set4(0)};
  return FastTwoSum4(first, rest.high / b.high);
}

// ---- core/intersect/rounded_ray.h, lane by lane ----

/// Four rays, each with the triangle that it hits; in local coordinates.
struct ExactHits4 {
  alignas(32) double direction[3][4];
  alignas(32) double origin[3][4], origin_low[3][4], origin_size[4];
  alignas(32) double shift[4], shift_low[4];
  alignas(32) double corner[3][3][4];  // of corner a, b, c the coordinates x, y, z

  void SetRay(unsigned k, const RoundedRay& ray) {
    for (int axis = 0; axis < 3; ++axis) {
      direction[axis][k] = ray.direction[axis];
      origin[axis][k] = ray.origin[axis];
      origin_low[axis][k] = ray.origin_low[axis];
    }
    origin_size[k] = ray.OriginSize();
    shift[k] = ray.shift;
    shift_low[k] = ray.shift_low;
  }
  template <class Number>
  void SetCorner(unsigned k, int which, const Vec3<Number>& at) {
    for (int axis = 0; axis < 3; ++axis) {
      corner[which][axis][k] = static_cast<double>(at[axis]);
    }
  }
};

struct SizedVector4 {
  DoubleDouble4 at[3];
  D4 size[3];
};
KDRAY_INLINE SizedVector4 Cross4(const SizedVector4& a, const SizedVector4& b) {
  SizedVector4 product;
  for (int k = 0; k < 3; ++k) {
    const int i = k == 2 ? 0 : k + 1;
    const int j = i == 2 ? 0 : i + 1;
    product.at[k] = a.at[i] * b.at[j] - a.at[j] * b.at[i];
    product.size[k] = a.size[i] * b.size[j] + a.size[j] * b.size[i];
  }
  return product;
}

struct BoundedNumber4 {
  DoubleDouble4 value;
  D4 error;
};
KDRAY_INLINE BoundedNumber4 Dot4(const SizedVector4& a, const SizedVector4& b) {
  const D4 size = a.size[0] * b.size[0] + a.size[1] * b.size[1] + a.size[2] * b.size[2];
  return {(a.at[0] * b.at[0] + a.at[1] * b.at[1]) + a.at[2] * b.at[2],
          Set4(RoundedRay::kStep) * size + Set4(RoundedRay::kUnderflow)};
}
KDRAY_INLINE BoundedNumber4 Ratio4(const BoundedNumber4& numerator,
                                   const BoundedNumber4& denominator) {
  const DoubleDouble4 ratio = numerator.value / denominator.value;
  return {ratio, Set4(2) * (numerator.error + Abs(ratio.high) * denominator.error) /
                     Abs(denominator.value.high)};
}
/// Returns the lanes whose bound leaves only one nearest double.
KDRAY_INLINE unsigned RoundTo4(const DoubleDouble4& x, D4 error, D4* rounded) {
  *rounded = x.high + (x.low - error);
  return Bits(L4(*rounded == x.high + (x.low + error)));
}
KDRAY_INLINE unsigned RoundToWeight4(const BoundedNumber4& x, double* rounded) {
  const D4 small = Set4(kSmallWeight);
  const D4 added = D4(L4(x.value.high < small) & L4(small));
  const DoubleDouble4 sum = TwoSum4(added, x.value.high);
  D4 weight;
  const unsigned known =
      RoundTo4({sum.high, sum.low + x.value.low}, x.error + Set4(0x1p-110), &weight);
  Store(weight - added, rounded);
  return known;
}

/// RoundedRay::Solve. Returns the lanes that need no more digits; t counts lengths of the local
/// direction.
KDRAY_INLINE unsigned Solve4(const ExactHits4& hits, double* t, double* u, double* v) {
  const D4 zero = Set4(0);
  SizedVector4 d, e, f, g;
  for (int k = 0; k < 3; ++k) {
    const D4 a = Load4(hits.corner[0][k]);
    d.at[k] = {Load4(hits.direction[k]), zero};
    e.at[k] = TwoDifference4(Load4(hits.corner[1][k]), a);
    f.at[k] = TwoDifference4(Load4(hits.corner[2][k]), a);
    g.at[k] =
        TwoDifference4(Load4(hits.origin[k]), a) + DoubleDouble4{Load4(hits.origin_low[k]), zero};
    d.size[k] = Abs(d.at[k].high);
    e.size[k] = Abs(e.at[k].high);
    f.size[k] = Abs(f.at[k].high);
    g.size[k] = Abs(g.at[k].high) + Load4(hits.origin_size);
  }
  const SizedVector4 fd = Cross4(f, d), eg = Cross4(e, g);
  const BoundedNumber4 sum = Dot4(e, fd);
  const D4 least = Abs(sum.value.high);
  unsigned known =
      Bits(L4((least > Set4(RoundedRay::kLeastDenominator)) & (least > Set4(4) * sum.error)));
  const BoundedNumber4 s = Ratio4(Dot4(f, eg), sum);
  const D4 shift = Load4(hits.shift);
  D4 along;
  known &= RoundTo4(DoubleDouble4{shift, Load4(hits.shift_low)} + s.value,
                    s.error + Set4(0x1p-100) * Abs(shift), &along);
  Store(along, t);
  known &= RoundToWeight4(Ratio4(Dot4(g, fd), sum), u);
  known &= RoundToWeight4(Ratio4(Dot4(d, eg), sum), v);
  return known;
}

/// Whether scaling to the caller's t rounded nothing: true except for numbers below the normal
/// range.
KDRAY_INLINE bool IsRoundedOnce(double caller_t) {
  return std::fabs(caller_t) >= std::numeric_limits<double>::min();
}

// ---- Answers ----

/// Collects the hits of ended searches and writes them four at a time. Flush() writes the rest.
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
      hits_.SetCorner(size_, corner, search.best_corners[corner]);
    }
    exponent_[size_] = search.exponent;
    row_[size_] = search.row;
    id_[size_] = search.best_id;
    if (++size_ == 4) Flush(job);
  }

  void Flush(const KernelJob& job) {
    if (size_ == 0) return;
    alignas(32) double t[4], u[4], v[4];
    const unsigned known = Solve4(hits_, t, u, v);
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

  ExactHits4 hits_ = {};
  int exponent_[4] = {};
  std::size_t row_[4] = {};
  PrimitiveId id_[4] = {};
  unsigned size_ = 0;
};

}  // namespace kdray::core::KDRAY_ISA
KDRAY_END_ISA();
