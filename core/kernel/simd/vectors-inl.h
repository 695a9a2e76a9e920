// SPDX-License-Identifier: Apache-2.0
// Vectors of 8 and 16 floats and 8 doubles, the widths of the data (WideNode, LeafBlock, packets of
// rays), in one, two or four registers of the target.
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

// ---- Sixteen floats ----

#if defined(KDRAY_ISA_AVX512)

using F16 = float __attribute__((vector_size(64)));
struct M16 {
  __mmask16 bits;
};
KDRAY_INLINE F16 Set16(float x) { return F16(_mm512_set1_ps(x)); }
KDRAY_INLINE F16 Load16(const float* from) { return F16(_mm512_loadu_ps(from)); }
KDRAY_INLINE void Store(F16 v, float* to) { _mm512_storeu_ps(to, __m512(v)); }
KDRAY_INLINE F16 Min(F16 a, F16 b) { return F16(_mm512_min_ps(__m512(a), __m512(b))); }
KDRAY_INLINE F16 Max(F16 a, F16 b) { return F16(_mm512_max_ps(__m512(a), __m512(b))); }
KDRAY_INLINE F16 Abs(F16 a) { return F16(_mm512_abs_ps(__m512(a))); }
KDRAY_INLINE F16 MulSub(F16 a, F16 b, F16 c) {
  return F16(_mm512_fmsub_ps(__m512(a), __m512(b), __m512(c)));
}
/// c - a * b, fused or not.
KDRAY_INLINE F16 NegMulAdd(F16 a, F16 b, F16 c) {
  return F16(_mm512_fnmadd_ps(__m512(a), __m512(b), __m512(c)));
}
KDRAY_INLINE M16 LessEqual(F16 a, F16 b) {
  return {_mm512_cmp_ps_mask(__m512(a), __m512(b), _CMP_LE_OQ)};
}
KDRAY_INLINE M16 Less(F16 a, F16 b) {
  return {_mm512_cmp_ps_mask(__m512(a), __m512(b), _CMP_LT_OQ)};
}
KDRAY_INLINE M16 NotEqual(F16 a, F16 b) {
  return {_mm512_cmp_ps_mask(__m512(a), __m512(b), _CMP_NEQ_OQ)};
}
KDRAY_INLINE M16 operator&(M16 a, M16 b) { return {_kand_mask16(a.bits, b.bits)}; }
KDRAY_INLINE M16 operator|(M16 a, M16 b) { return {_kor_mask16(a.bits, b.bits)}; }
KDRAY_INLINE unsigned Bits(M16 m) { return m.bits; }
/// `a` in the lanes of set bits, `b` in the others.
KDRAY_INLINE F16 Select(unsigned bits, F16 a, F16 b) {
  return F16(_mm512_mask_blend_ps(static_cast<__mmask16>(bits), __m512(b), __m512(a)));
}
KDRAY_INLINE void Fill16(std::uint32_t value, std::uint32_t* to) {
  _mm512_storeu_si512(to, _mm512_set1_epi32(static_cast<int>(value)));
}
/// first + i for every bit i that is set, in order; 16 numbers are written, the rest anything.
KDRAY_INLINE void StoreIndices(unsigned bits, std::uint32_t first, std::uint32_t* to) {
  const __m512i index =
      _mm512_add_epi32(_mm512_set1_epi32(static_cast<int>(first)),
                       _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15));
  _mm512_storeu_si512(to, _mm512_maskz_compress_epi32(static_cast<__mmask16>(bits), index));
}
/// from[index[i]] where `from` has 8, or 64 floats.
KDRAY_INLINE F16 LookUp8(const float* from, const std::uint32_t* index) {
  return F16(_mm512_permutexvar_ps(_mm512_loadu_si512(index),
                                   _mm512_castps256_ps512(_mm256_loadu_ps(from))));
}
KDRAY_INLINE void LookUp8(const std::uint32_t* from, const std::uint32_t* index,
                          std::uint32_t* to) {
  _mm512_storeu_si512(
      to, _mm512_permutexvar_epi32(
              _mm512_loadu_si512(index),
              _mm512_castsi256_si512(_mm256_loadu_si256(reinterpret_cast<const __m256i*>(from)))));
}
KDRAY_INLINE F16 LookUp64(const float* from, const std::uint32_t* index) {
  const __m512i at = _mm512_loadu_si512(index);
  const __m512 low = _mm512_permutex2var_ps(_mm512_loadu_ps(from), at, _mm512_loadu_ps(from + 16));
  const __m512 high =
      _mm512_permutex2var_ps(_mm512_loadu_ps(from + 32), at, _mm512_loadu_ps(from + 48));
  return F16(_mm512_mask_blend_ps(_mm512_test_epi32_mask(at, _mm512_set1_epi32(32)), low, high));
}
KDRAY_INLINE float Smallest(F16 v) { return _mm512_reduce_min_ps(__m512(v)); }
KDRAY_INLINE float Largest(F16 v) { return _mm512_reduce_max_ps(__m512(v)); }

#else

struct F16 {
  F8 low, high;
};
struct M16 {
  M8 low, high;
};
KDRAY_INLINE F16 Set16(float x) { return {Set8(x), Set8(x)}; }
KDRAY_INLINE F16 Load16(const float* from) { return {Load(from), Load(from + 8)}; }
KDRAY_INLINE void Store(F16 v, float* to) {
  Store(v.low, to);
  Store(v.high, to + 8);
}
KDRAY_INLINE F16 operator+(F16 a, F16 b) { return {a.low + b.low, a.high + b.high}; }
KDRAY_INLINE F16 operator-(F16 a, F16 b) { return {a.low - b.low, a.high - b.high}; }
KDRAY_INLINE F16 operator*(F16 a, F16 b) { return {a.low * b.low, a.high * b.high}; }
KDRAY_INLINE F16 operator/(F16 a, F16 b) { return {a.low / b.low, a.high / b.high}; }
KDRAY_INLINE F16 Min(F16 a, F16 b) { return {Min(a.low, b.low), Min(a.high, b.high)}; }
KDRAY_INLINE F16 Max(F16 a, F16 b) { return {Max(a.low, b.low), Max(a.high, b.high)}; }
KDRAY_INLINE F16 Abs(F16 a) { return {Abs(a.low), Abs(a.high)}; }
KDRAY_INLINE F16 MulSub(F16 a, F16 b, F16 c) {
  return {MulSub(a.low, b.low, c.low), MulSub(a.high, b.high, c.high)};
}
/// c - a * b, fused or not.
KDRAY_INLINE F16 NegMulAdd(F16 a, F16 b, F16 c) {
  return {NegMulAdd(a.low, b.low, c.low), NegMulAdd(a.high, b.high, c.high)};
}
KDRAY_INLINE M16 LessEqual(F16 a, F16 b) {
  return {LessEqual(a.low, b.low), LessEqual(a.high, b.high)};
}
KDRAY_INLINE M16 Less(F16 a, F16 b) { return {Less(a.low, b.low), Less(a.high, b.high)}; }
KDRAY_INLINE M16 NotEqual(F16 a, F16 b) {
  return {NotEqual(a.low, b.low), NotEqual(a.high, b.high)};
}
KDRAY_INLINE M16 operator&(M16 a, M16 b) { return {a.low & b.low, a.high & b.high}; }
KDRAY_INLINE M16 operator|(M16 a, M16 b) { return {a.low | b.low, a.high | b.high}; }
KDRAY_INLINE unsigned Bits(M16 m) { return Bits(m.low) | Bits(m.high) << 8; }
KDRAY_INLINE F8 Select(unsigned bits, F8 a, F8 b) {
#if defined(KDRAY_ISA_AVX512)
  return F8(_mm256_mask_blend_ps(static_cast<__mmask8>(bits), __m256(b), __m256(a)));
#else
  const I8 lane = {1, 2, 4, 8, 16, 32, 64, 128};
  const S8 mask = S8((SetI8(bits) & lane) == lane);
  return mask ? a : b;
#endif
}
KDRAY_INLINE F16 Select(unsigned bits, F16 a, F16 b) {
  return {Select(bits & 255u, a.low, b.low), Select(bits >> 8, a.high, b.high)};
}
KDRAY_INLINE void Fill16(std::uint32_t value, std::uint32_t* to) {
  Store(SetI8(value), to);
  Store(SetI8(value), to + 8);
}
/// first + i for every bit i that is set, in order; 16 numbers are written, the rest anything.
KDRAY_INLINE void StoreIndices(unsigned bits, std::uint32_t first, std::uint32_t* to) {
  const unsigned low = bits & 255u;
  Store(SetI8(first) + UnpackOrder(kCompressTable.packed[low]) % 16, to);
  Store(SetI8(first + 8) + UnpackOrder(kCompressTable.packed[bits >> 8]) % 16,
        to + __builtin_popcount(low));
}
/// from[index[i]] where `from` has 8, or 64 floats.
KDRAY_INLINE F16 LookUp8(const float* from, const std::uint32_t* index) {
  return {Permute(Load(from), Load(index)), Permute(Load(from), Load(index + 8))};
}
KDRAY_INLINE void LookUp8(const std::uint32_t* from, const std::uint32_t* index,
                          std::uint32_t* to) {
  Store(Permute(Load(from), Load(index)), to);
  Store(Permute(Load(from), Load(index + 8)), to + 8);
}
KDRAY_INLINE F16 LookUp64(const float* from, const std::uint32_t* index) {
  F16 v;
  for (int i = 0; i < 8; ++i) {
    v.low[i] = from[index[i] % 64];
    v.high[i] = from[index[i + 8] % 64];
  }
  return v;
}
KDRAY_INLINE float Smallest(F16 v) {
  const F8 m = Min(v.low, v.high);
  float smallest = m[0];
  for (int k = 1; k < 8; ++k) smallest = m[k] < smallest ? m[k] : smallest;
  return smallest;
}
KDRAY_INLINE float Largest(F16 v) {
  const F8 m = Max(v.low, v.high);
  float largest = m[0];
  for (int k = 1; k < 8; ++k) largest = m[k] > largest ? m[k] : largest;
  return largest;
}

#endif

// ---- Sixty-four bytes ----

/// Bit k of the result is the given bit of bytes[k].
KDRAY_INLINE std::uint64_t BitOfBytes(const std::uint8_t* bytes, unsigned bit) {
#if defined(KDRAY_ISA_AVX512)
  return _mm512_test_epi8_mask(_mm512_loadu_si512(bytes),
                               _mm512_set1_epi8(static_cast<char>(1u << bit)));
#elif defined(KDRAY_ISA_AVX2)
  const __m128i up = _mm_cvtsi32_si128(static_cast<int>(7 - bit));  // to the sign of each byte
  const auto signs = [&](const std::uint8_t* from) KDRAY_LAMBDA {
    const __m256i v = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(from));
    return static_cast<std::uint32_t>(_mm256_movemask_epi8(_mm256_sll_epi16(v, up)));
  };
  return signs(bytes) | std::uint64_t{signs(bytes + 32)} << 32;
#elif defined(__SSE2__)
  const __m128i up = _mm_cvtsi32_si128(static_cast<int>(7 - bit));
  std::uint64_t bits = 0;
  for (unsigned k = 0; k < 64; k += 16) {
    const __m128i v = _mm_loadu_si128(reinterpret_cast<const __m128i*>(bytes + k));
    const int signs = _mm_movemask_epi8(_mm_sll_epi16(v, up));
    bits |= std::uint64_t{static_cast<unsigned>(signs)} << k;
  }
  return bits;
#else
  std::uint64_t bits = 0;
  for (unsigned k = 0; k < 64; ++k) bits |= std::uint64_t{bytes[k] >> bit & 1u} << k;
  return bits;
#endif
}

}  // namespace kdray::core::KDRAY_ISA
KDRAY_END_ISA();
