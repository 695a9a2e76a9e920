// SPDX-License-Identifier: Apache-2.0
// When the rows of the frustum kernel are fetched.
#pragma once

#include <algorithm>
#include <cstddef>

#include "core/geometry/hit.h"
#include "core/kernel/kernel.h"
#include "core/kernel/simd/isa.h"
#include "core/kernel/simd/packet-inl.h"
#include "core/kernel/simd/vectors-inl.h"

KDRAY_BEGIN_ISA();
namespace kdray::core::KDRAY_ISA {

/// Prefetches a packet's answers and the next packet's rays, a few lines for each step of the
/// packet: the processor waits for few lines at once, and more would hold up the step's own loads.
class RowPrefetch {
 public:
  RowPrefetch(const KernelJob& job, std::size_t first, std::size_t last)
      : job_(job),
        answer_(first),
        answers_end_(job.hits != nullptr ? first + FrustumRays::kRays : first),
        ray_(first + FrustumRays::kRays),
        // One row more: the last one may end on a line of its own.
        rays_end_(std::min(last, first + 2 * FrustumRays::kRays + 1)),
        rays_of_line_(job.rays.floats() != nullptr ? 2 : 1) {}

  KDRAY_INLINE void Some() {
    for (int k = 0; k < 3; ++k) {
      if (ray_ < rays_end_) NextRay();
      if (answer_ < answers_end_) NextAnswer();
    }
  }
  void Rest() {
    while (ray_ < rays_end_) NextRay();
    while (answer_ < answers_end_) NextAnswer();
  }

 private:
  KDRAY_INLINE void NextRay() {
    job_.rays.Prefetch(RowAt(job_, ray_));
    ray_ += rays_of_line_;
  }
  KDRAY_INLINE void NextAnswer() {
    __builtin_prefetch(&job_.hits[RowAt(job_, answer_)], 1);
    answer_ += 64 / sizeof(Hit);
  }

  const KernelJob& job_;
  std::size_t answer_;
  const std::size_t answers_end_;
  std::size_t ray_;
  const std::size_t rays_end_;
  const std::size_t rays_of_line_;
};

}  // namespace kdray::core::KDRAY_ISA
KDRAY_END_ISA();
