// SPDX-License-Identifier: Apache-2.0
// Vectors of 8 floats and 4 doubles, the widths of nodes and blocks of triangles, in one or two
// registers of the target. vectors16-inl.h has those of 16 floats.
//
// Every operation is the plain IEEE one on each lane, except MulAdd, MulSub and NegMulAdd, which
// may be fused: they are only for culling and bounds.
#pragma once

#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>

#include "core/kernel/simd/isa.h"

KDRAY_BEGIN_ISA();
namespace kdray::core::KDRAY_ISA {

// ---- One register where there is AVX-512, pairs of smaller ones elsewhere ----

using F8 = float __attribute__((vector_size(32)));
using I8 = std::uint32_t __attribute__((vector_size(32)));
using D4 = double __attribute__((vector_size(32)));
using L4 = std::int64_t __attribute__((vector_size(32)));
using S8 = std::int32_t __attribute__((vector_size(32)));

#define KDRAY_INLINE inline __attribute__((always_inline))
#define KDRAY_LAMBDA __attribute__((always_inline))

KDRAY_INLINE F8 Load(const float* from) {
  F8 v;
  __builtin_memcpy(&v, from, sizeof(v));
  return v;
}
KDRAY_INLINE I8 Load(const std::uint32_t* from) {
  I8 v;
  __builtin_memcpy(&v, from, sizeof(v));
  return v;
}
KDRAY_INLINE void Store(F8 v, float* to) { __builtin_memcpy(to, &v, sizeof(v)); }
KDRAY_INLINE void Store(I8 v, std::uint32_t* to) { __builtin_memcpy(to, &v, sizeof(v)); }
KDRAY_INLINE F8 Set8(float x) { return F8{x, x, x, x, x, x, x, x}; }
KDRAY_INLINE I8 SetI8(std::uint32_t x) { return I8{x, x, x, x, x, x, x, x}; }

#if defined(KDRAY_ISA_AVX512) || defined(KDRAY_ISA_AVX2)

KDRAY_INLINE F8 MulSub(F8 a, F8 b, F8 c) {
  return F8(_mm256_fmsub_ps(__m256(a), __m256(b), __m256(c)));
}
KDRAY_INLINE F8 MulAdd(F8 a, F8 b, F8 c) {
  return F8(_mm256_fmadd_ps(__m256(a), __m256(b), __m256(c)));
}
/// c - a * b, fused or not.
KDRAY_INLINE F8 NegMulAdd(F8 a, F8 b, F8 c) {
  return F8(_mm256_fnmadd_ps(__m256(a), __m256(b), __m256(c)));
}
KDRAY_INLINE F8 Min(F8 a, F8 b) { return F8(_mm256_min_ps(__m256(a), __m256(b))); }
KDRAY_INLINE F8 Max(F8 a, F8 b) { return F8(_mm256_max_ps(__m256(a), __m256(b))); }
KDRAY_INLINE F8 Abs(F8 a) { return F8(_mm256_andnot_ps(_mm256_set1_ps(-0.0f), __m256(a))); }
KDRAY_INLINE F8 Permute(F8 v, I8 index) {
  return F8(_mm256_permutevar8x32_ps(__m256(v), __m256i(index)));
}
KDRAY_INLINE I8 Permute(I8 v, I8 index) {
  return I8(_mm256_permutevar8x32_epi32(__m256i(v), __m256i(index)));
}
/// Lane k: bits 4k.. of `packed`, of which Permute uses three.
KDRAY_INLINE I8 UnpackOrder(std::uint32_t packed) {
  return I8(_mm256_srlv_epi32(_mm256_set1_epi32(static_cast<int>(packed)),
                              _mm256_setr_epi32(0, 4, 8, 12, 16, 20, 24, 28)));
}

#else

KDRAY_INLINE F8 MulSub(F8 a, F8 b, F8 c) { return a * b - c; }
KDRAY_INLINE F8 MulAdd(F8 a, F8 b, F8 c) { return a * b + c; }
KDRAY_INLINE F8 NegMulAdd(F8 a, F8 b, F8 c) { return c - a * b; }
KDRAY_INLINE F8 Min(F8 a, F8 b) { return a < b ? a : b; }
KDRAY_INLINE F8 Max(F8 a, F8 b) { return a > b ? a : b; }
KDRAY_INLINE F8 Abs(F8 a) { return F8(I8(a) & SetI8(0x7fffffffu)); }
#ifdef __clang__  // which shuffles by constants only
template <class Lanes>
KDRAY_INLINE Lanes Permute(Lanes v, I8 index) {
  Lanes permuted = v;
  for (int k = 0; k < 8; ++k) permuted[k] = v[index[k] & 7];
  return permuted;
}
#else
KDRAY_INLINE F8 Permute(F8 v, I8 index) { return __builtin_shuffle(v, S8(index & SetI8(7))); }
KDRAY_INLINE I8 Permute(I8 v, I8 index) { return __builtin_shuffle(v, index & SetI8(7)); }
#endif
KDRAY_INLINE I8 UnpackOrder(std::uint32_t packed) {
  return SetI8(packed) >> I8{0, 4, 8, 12, 16, 20, 24, 28};
}

#endif

// ---- Masks ----

#if defined(KDRAY_ISA_AVX512)

struct M8 {
  __mmask8 bits;
};
KDRAY_INLINE unsigned Bits(M8 m) { return m.bits; }
KDRAY_INLINE M8 operator&(M8 a, M8 b) { return {_kand_mask8(a.bits, b.bits)}; }
KDRAY_INLINE M8 operator|(M8 a, M8 b) { return {_kor_mask8(a.bits, b.bits)}; }
KDRAY_INLINE M8 LessEqual(F8 a, F8 b) {
  return {_mm256_cmp_ps_mask(__m256(a), __m256(b), _CMP_LE_OQ)};
}
KDRAY_INLINE M8 NotEqual(F8 a, F8 b) {
  return {_mm256_cmp_ps_mask(__m256(a), __m256(b), _CMP_NEQ_OQ)};
}

#else

struct M8 {
  S8 lanes;  // all ones or 0
};
KDRAY_INLINE M8 operator&(M8 a, M8 b) { return {a.lanes & b.lanes}; }
KDRAY_INLINE M8 operator|(M8 a, M8 b) { return {a.lanes | b.lanes}; }
#if defined(KDRAY_ISA_AVX2)
KDRAY_INLINE unsigned Bits(M8 m) {
  return static_cast<unsigned>(_mm256_movemask_ps(__m256(m.lanes)));
}
#elif defined(__SSE2__)
KDRAY_INLINE unsigned Bits(M8 m) {
  __m128 halves[2];
  __builtin_memcpy(halves, &m.lanes, sizeof(halves));
  return static_cast<unsigned>(_mm_movemask_ps(halves[0]) | _mm_movemask_ps(halves[1]) << 4);
}
#else
KDRAY_INLINE unsigned Bits(M8 m) {
  unsigned bits = 0;
  for (unsigned k = 0; k < 8; ++k) bits |= (static_cast<std::uint32_t>(m.lanes[k]) >> 31) << k;
  return bits;
}
#endif
KDRAY_INLINE M8 LessEqual(F8 a, F8 b) { return {S8(a <= b)}; }
KDRAY_INLINE M8 Less(F8 a, F8 b) { return {S8(a < b)}; }
KDRAY_INLINE M8 NotEqual(F8 a, F8 b) { return {S8((a < b) | (a > b))}; }

#endif

/// The lanes that are equal.
KDRAY_INLINE unsigned EqualLanes(I8 a, I8 b) {
#if defined(KDRAY_ISA_AVX512)
  return _mm256_cmpeq_epi32_mask(__m256i(a), __m256i(b));
#else
  return Bits(M8{S8(a == b)});
#endif
}

/// `a` in the lanes of set bits, `b` in the others.
KDRAY_INLINE F8 Select(unsigned bits, F8 a, F8 b) {
#if defined(KDRAY_ISA_AVX512)
  return F8(_mm256_mask_blend_ps(static_cast<__mmask8>(bits), __m256(b), __m256(a)));
#else
  const I8 lane = {1, 2, 4, 8, 16, 32, 64, 128};
  const S8 mask = S8((SetI8(bits) & lane) == lane);
  return mask ? a : b;
#endif
}

// ---- Compress: the lanes whose bits are set, moved down; the others' places hold anything ----

#if defined(KDRAY_ISA_AVX512)
KDRAY_INLINE F8 Compress(unsigned bits, F8 v) {
  return F8(_mm256_maskz_compress_ps(static_cast<__mmask8>(bits), __m256(v)));
}
KDRAY_INLINE I8 Compress(unsigned bits, I8 v) {
  return I8(_mm256_maskz_compress_epi32(static_cast<__mmask8>(bits), __m256i(v)));
}
#else
// [bits]: the positions of the set bits, four bits each.
struct CompressTable {
  std::uint32_t packed[256];
  constexpr CompressTable() : packed() {
    for (unsigned bits = 0; bits < 256; ++bits) {
      unsigned place = 0;
      for (unsigned lane = 0; lane < 8; ++lane) {
        if ((bits >> lane & 1u) != 0) packed[bits] |= lane << (4 * place++);
      }
    }
  }
};
inline constexpr CompressTable kCompressTable;
KDRAY_INLINE F8 Compress(unsigned bits, F8 v) {
  return Permute(v, UnpackOrder(kCompressTable.packed[bits]));
}
KDRAY_INLINE I8 Compress(unsigned bits, I8 v) {
  return Permute(v, UnpackOrder(kCompressTable.packed[bits]));
}
#endif

// ---- Four doubles ----

KDRAY_INLINE D4 Set4(double x) { return D4{x, x, x, x}; }
KDRAY_INLINE void Store(D4 v, double* to) { __builtin_memcpy(to, &v, sizeof(v)); }
KDRAY_INLINE D4 Load4(const double* from) {
  D4 v;
  __builtin_memcpy(&v, from, sizeof(v));
  return v;
}
KDRAY_INLINE D4 Abs(D4 v) { return D4(L4(v) & std::numeric_limits<std::int64_t>::max()); }
using F4 = float __attribute__((vector_size(16)));
using U4 = std::uint32_t __attribute__((vector_size(16)));
using S4 = std::int32_t __attribute__((vector_size(16)));
KDRAY_INLINE void StoreF4(F4 v, float* to) { __builtin_memcpy(to, &v, sizeof(v)); }
KDRAY_INLINE F4 Narrow(D4 v) { return __builtin_convertvector(v, F4); }
KDRAY_INLINE D4 Widen4(const double* from) { return Load4(from); }
KDRAY_INLINE D4 Widen4(const float* from) {
  F4 v;
  __builtin_memcpy(&v, from, sizeof(v));
  return __builtin_convertvector(v, D4);
}
KDRAY_INLINE D4 Widen(F4 v) { return __builtin_convertvector(v, D4); }
/// From rows to columns.
KDRAY_INLINE void Transpose4(F4 (&rows)[4]) {
  const F4 low01 = __builtin_shufflevector(rows[0], rows[1], 0, 4, 1, 5);
  const F4 low23 = __builtin_shufflevector(rows[2], rows[3], 0, 4, 1, 5);
  const F4 high01 = __builtin_shufflevector(rows[0], rows[1], 2, 6, 3, 7);
  const F4 high23 = __builtin_shufflevector(rows[2], rows[3], 2, 6, 3, 7);
  rows[0] = __builtin_shufflevector(low01, low23, 0, 1, 4, 5);
  rows[1] = __builtin_shufflevector(low01, low23, 2, 3, 6, 7);
  rows[2] = __builtin_shufflevector(high01, high23, 0, 1, 4, 5);
  rows[3] = __builtin_shufflevector(high01, high23, 2, 3, 6, 7);
}
KDRAY_INLINE void Transpose4(D4 (&rows)[4]) {
  const D4 even01 = __builtin_shufflevector(rows[0], rows[1], 0, 4, 2, 6);
  const D4 odd01 = __builtin_shufflevector(rows[0], rows[1], 1, 5, 3, 7);
  const D4 even23 = __builtin_shufflevector(rows[2], rows[3], 0, 4, 2, 6);
  const D4 odd23 = __builtin_shufflevector(rows[2], rows[3], 1, 5, 3, 7);
  rows[0] = __builtin_shufflevector(even01, even23, 0, 1, 4, 5);
  rows[1] = __builtin_shufflevector(odd01, odd23, 0, 1, 4, 5);
  rows[2] = __builtin_shufflevector(even01, even23, 2, 3, 6, 7);
  rows[3] = __builtin_shufflevector(odd01, odd23, 2, 3, 6, 7);
}
KDRAY_INLINE F4 Abs(F4 v) {
  return F4(U4(v) & U4{0x7fffffffu, 0x7fffffffu, 0x7fffffffu, 0x7fffffffu});
}
KDRAY_INLINE D4 Select(L4 mask, D4 a, D4 b) { return mask ? a : b; }

#if defined(KDRAY_ISA_AVX512) || defined(KDRAY_ISA_AVX2)
KDRAY_INLINE D4 Min(D4 a, D4 b) { return D4(_mm256_min_pd(__m256d(a), __m256d(b))); }
KDRAY_INLINE D4 Max(D4 a, D4 b) { return D4(_mm256_max_pd(__m256d(a), __m256d(b))); }
KDRAY_INLINE unsigned Bits(L4 m) { return static_cast<unsigned>(_mm256_movemask_pd(__m256d(m))); }
/// a * b - rounded(a * b), exactly.
KDRAY_INLINE D4 ProductError(D4 a, D4 b, D4 product) {
  return D4(_mm256_fmsub_pd(__m256d(a), __m256d(b), __m256d(product)));
}
KDRAY_INLINE D4 MulAdd(D4 a, D4 b, D4 c) {
  return D4(_mm256_fmadd_pd(__m256d(a), __m256d(b), __m256d(c)));
}
KDRAY_INLINE D4 MulSub(D4 a, D4 b, D4 c) {
  return D4(_mm256_fmsub_pd(__m256d(a), __m256d(b), __m256d(c)));
}
#else
KDRAY_INLINE D4 MulAdd(D4 a, D4 b, D4 c) { return a * b + c; }
KDRAY_INLINE D4 MulSub(D4 a, D4 b, D4 c) { return a * b - c; }
KDRAY_INLINE D4 Min(D4 a, D4 b) { return a < b ? a : b; }
KDRAY_INLINE D4 Max(D4 a, D4 b) { return a > b ? a : b; }
KDRAY_INLINE unsigned Bits(L4 m) {
  unsigned bits = 0;
  for (unsigned k = 0; k < 4; ++k) bits |= static_cast<unsigned>(m[k] & 1) << k;
  return bits;
}
KDRAY_INLINE D4 ProductError(D4 a, D4 b, D4 product) {
  D4 error;
  for (int k = 0; k < 4; ++k) error[k] = std::fma(a[k], b[k], -product[k]);
  return error;
}
#endif

// ---- Lane by lane what core/intersect/difference_of_products.h does ----

KDRAY_INLINE D4 DifferenceOfProducts4(D4 a, D4 b, D4 c, D4 d) {
  const D4 ab = a * b;
  const D4 cd = c * d;
  return (ab - cd) + (ProductError(a, b, ab) - ProductError(c, d, cd));
}
KDRAY_INLINE D4 SymmetricSum4(D4 a, D4 b, D4 c) {
  const D4 low = Min(Min(a, b), c);
  const D4 high = Max(Max(a, b), c);
  const D4 middle = Max(Min(a, b), Min(Max(a, b), c));
  return (low + high) + middle;
}

}  // namespace kdray::core::KDRAY_ISA
KDRAY_END_ISA();
