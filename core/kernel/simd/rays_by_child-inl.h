// SPDX-License-Identifier: Apache-2.0
// Which of 64 rays meet each child of a node: collected ray by ray or for 16 rays at once, then
// stored as entries of a stack.
#pragma once

#include <cstddef>
#include <cstdint>

#include "core/accel/wide/wide_tree.h"
#include "core/kernel/simd/isa.h"
#include "core/kernel/simd/vectors-inl.h"
#include "core/kernel/simd/vectors16-inl.h"

KDRAY_BEGIN_ISA();
namespace kdray::core::KDRAY_ISA {

/// AddRay() and AddGroup() are called at most once for each ray.
class RaysByChild {
 public:
  KDRAY_INLINE RaysByChild();
  /// Adds the ray at place k with the children that it meets.
  KDRAY_INLINE void AddRay(std::size_t k, M8 children);
  /// Adds those of the 16 rays from place `first` on whose bit in `group` is set. meet(c) gives a
  /// bit for each of the 16 that meets child c.
  template <class Meet>
  KDRAY_INLINE void AddGroup(std::size_t first, unsigned group, const Meet& meet);
  /// Stores the children that a ray meets, farthest first for rays of the octant, and a bit for
  /// each ray that meets them. Writes eight entries and returns how many are valid.
  KDRAY_INLINE std::size_t StoreMet(const WideNode& node, unsigned octant, std::uint32_t* child,
                                    std::uint64_t* rays) const;

 private:
#if !defined(KDRAY_ISA_AVX512)
  KDRAY_INLINE void Collect(std::uint64_t (&met)[WideNode::kWidth]) const;
#endif
#if defined(KDRAY_ISA_AVX512)
  // By child. In a register: the children of a ray are a mask of lanes, and no vector is loaded
  // just after its bytes were stored, which is slow.
  __m512i rays_;
#elif defined(KDRAY_ISA_AVX2)
  std::uint64_t rays_[WideNode::kWidth] = {};  // by child, of AddGroup()
  __m256i alone_[2];                           // the same of AddRay()
#else
  std::uint64_t rays_[WideNode::kWidth] = {};  // by child, of AddGroup()
  std::uint64_t alone_ = 0;                    // the rays of AddRay()
  alignas(64) std::uint8_t met_[64];           // by such a ray: a bit for each child
#endif
};

#if defined(KDRAY_ISA_AVX512)

KDRAY_INLINE RaysByChild::RaysByChild() : rays_(_mm512_setzero_si512()) {}

KDRAY_INLINE void RaysByChild::AddRay(std::size_t k, M8 children) {
  const std::uint64_t bit = std::uint64_t{1} << k;
  rays_ = _mm512_mask_or_epi64(rays_, children.bits, rays_,
                               _mm512_set1_epi64(static_cast<long long>(bit)));
}

template <class Meet>
KDRAY_INLINE void RaysByChild::AddGroup(std::size_t first, unsigned group, const Meet& meet) {
  std::uint64_t four[2];  // 16 bits for each child
  for (std::size_t half = 0; half < 2; ++half) {
    four[half] = 0;
    for (std::size_t c = 0; c < 4; ++c) four[half] |= std::uint64_t{meet(4 * half + c)} << (16 * c);
  }
  const __m512i met = _mm512_cvtepu16_epi64(
      _mm_set_epi64x(static_cast<long long>(four[1]), static_cast<long long>(four[0])));
  const __m512i taken = _mm512_and_si512(met, _mm512_set1_epi64(static_cast<long long>(group)));
  rays_ = _mm512_or_si512(
      rays_, _mm512_sll_epi64(taken, _mm_cvtsi64_si128(static_cast<long long>(first))));
}

KDRAY_INLINE std::size_t RaysByChild::StoreMet(const WideNode& node, unsigned octant,
                                               std::uint32_t* child, std::uint64_t* rays) const {
  // Lane i: bits 4i.. of the order, of which permutations use three.
  const std::uint32_t order = node.order[octant];
  const __m512i index =
      _mm512_srlv_epi64(_mm512_set1_epi64(order), _mm512_setr_epi64(0, 4, 8, 12, 16, 20, 24, 28));
  const __m512i in_order = _mm512_permutexvar_epi64(index, rays_);
  const unsigned met = _mm512_test_epi64_mask(in_order, in_order);
  _mm512_storeu_si512(rays, _mm512_maskz_compress_epi64(static_cast<__mmask8>(met), in_order));
  Store(Compress(met, Permute(Load(node.child), UnpackOrder(order))), child);
  return static_cast<std::size_t>(__builtin_popcount(met));
}

#else

#if defined(KDRAY_ISA_AVX2)

KDRAY_INLINE RaysByChild::RaysByChild() : alone_{_mm256_setzero_si256(), _mm256_setzero_si256()} {}

KDRAY_INLINE void RaysByChild::AddRay(std::size_t k, M8 children) {
  const std::uint64_t one_bit = std::uint64_t{1} << k;
  const __m256i bit = _mm256_set1_epi64x(static_cast<long long>(one_bit));
  const auto add = [&](__m128i four, __m256i* to) KDRAY_LAMBDA {
    *to = _mm256_or_si256(*to, _mm256_and_si256(_mm256_cvtepi32_epi64(four), bit));
  };
  add(_mm256_castsi256_si128(__m256i(children.lanes)), &alone_[0]);
  add(_mm256_extracti128_si256(__m256i(children.lanes), 1), &alone_[1]);
}

KDRAY_INLINE void RaysByChild::Collect(std::uint64_t (&met)[WideNode::kWidth]) const {
  __builtin_memcpy(met, alone_, sizeof(met));
  for (std::size_t c = 0; c < WideNode::kWidth; ++c) met[c] |= rays_[c];
}

#else

KDRAY_INLINE RaysByChild::RaysByChild() = default;

KDRAY_INLINE void RaysByChild::AddRay(std::size_t k, M8 children) {
  met_[k] = static_cast<std::uint8_t>(Bits(children));
  alone_ |= std::uint64_t{1} << k;
}

KDRAY_INLINE void RaysByChild::Collect(std::uint64_t (&met)[WideNode::kWidth]) const {
  for (unsigned c = 0; c < WideNode::kWidth; ++c) {
    met[c] = rays_[c] | (alone_ != 0 ? BitOfBytes(met_, c) & alone_ : 0);
  }
}

#endif

template <class Meet>
KDRAY_INLINE void RaysByChild::AddGroup(std::size_t first, unsigned group, const Meet& meet) {
  for (std::size_t c = 0; c < WideNode::kWidth; ++c) {
    rays_[c] |= std::uint64_t{meet(c) & group} << first;
  }
}

KDRAY_INLINE std::size_t RaysByChild::StoreMet(const WideNode& node, unsigned octant,
                                               std::uint32_t* child, std::uint64_t* rays) const {
  std::uint64_t met[WideNode::kWidth];
  Collect(met);
  std::uint32_t order = node.order[octant];
  std::size_t size = 0;
  for (std::size_t i = 0; i < WideNode::kWidth; ++i, order >>= 4) {
    const std::uint32_t c = order & 7u;
    // Always written, kept if met: a branch would be unpredictable.
    child[size] = node.child[c];
    rays[size] = met[c];
    size += met[c] != 0 ? 1 : 0;
  }
  return size;
}

#endif

}  // namespace kdray::core::KDRAY_ISA
KDRAY_END_ISA();
