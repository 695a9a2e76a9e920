// SPDX-License-Identifier: Apache-2.0
// Vectors of 16 floats, the width of a group of rays, in one, two or four registers of the target;
// as vectors-inl.h.
#pragma once

#include <cstddef>
#include <cstdint>

#include "core/kernel/simd/isa.h"
#include "core/kernel/simd/vectors-inl.h"

KDRAY_BEGIN_ISA();
namespace kdray::core::KDRAY_ISA {

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
#if defined(KDRAY_ISA_AVX2)
KDRAY_INLINE float Smallest(F16 v) {
  const __m256 eight = __m256(Min(v.low, v.high));
  const __m128 four = _mm_min_ps(_mm256_castps256_ps128(eight), _mm256_extractf128_ps(eight, 1));
  const __m128 two = _mm_min_ps(four, _mm_movehl_ps(four, four));
  return _mm_cvtss_f32(_mm_min_ss(two, _mm_movehdup_ps(two)));
}
KDRAY_INLINE float Largest(F16 v) {
  const __m256 eight = __m256(Max(v.low, v.high));
  const __m128 four = _mm_max_ps(_mm256_castps256_ps128(eight), _mm256_extractf128_ps(eight, 1));
  const __m128 two = _mm_max_ps(four, _mm_movehl_ps(four, four));
  return _mm_cvtss_f32(_mm_max_ss(two, _mm_movehdup_ps(two)));
}
#else
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

#endif

/// (x - origin) * scale of 16 floats, computed in double, then rounded.
KDRAY_INLINE F16 ToLocal16(const float* from, double origin, double scale) {
#if defined(KDRAY_ISA_AVX512)
  const auto eight = [&](const float* x) KDRAY_LAMBDA {
    const __m512d moved =
        _mm512_sub_pd(_mm512_cvtps_pd(_mm256_loadu_ps(x)), _mm512_set1_pd(origin));
    return _mm512_cvtpd_ps(_mm512_mul_pd(moved, _mm512_set1_pd(scale)));
  };
  return F16(_mm512_insertf32x8(_mm512_castps256_ps512(eight(from)), eight(from + 8), 1));
#else
  // GCC takes vectors of more doubles than the target has apart, number by number.
  const auto four = [&](const float* x)
                        KDRAY_LAMBDA { return Narrow((Widen4(x) - Set4(origin)) * Set4(scale)); };
  const auto eight = [&](const float* x) KDRAY_LAMBDA {
    return F8(__builtin_shufflevector(four(x), four(x + 4), 0, 1, 2, 3, 4, 5, 6, 7));
  };
  return {eight(from), eight(from + 8)};
#endif
}

/// One number in all lanes of F8 or F16.
template <class Lanes>
KDRAY_INLINE Lanes SetAll(float x) {
  if constexpr (sizeof(Lanes) == sizeof(F8)) {
    return Set8(x);
  } else {
    return Set16(x);
  }
}

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
