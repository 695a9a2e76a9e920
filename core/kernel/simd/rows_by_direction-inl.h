// SPDX-License-Identifier: Apache-2.0
// Rows whose directions have one octant and one largest axis, collected for packets of the frustum
// kernel. Where a row of pixels passes from one octant to another, and around a lamp, 64 rays in a
// row are no packet, but those of several such rows are a few.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <span>

#include "core/kernel/kernel.h"
#include "core/kernel/simd/isa.h"
#include "core/kernel/simd/packet-inl.h"
#include "core/kernel/simd/vectors-inl.h"

KDRAY_BEGIN_ISA();
namespace kdray::core::KDRAY_ISA {

class RowsByDirection {
 public:
  static constexpr std::size_t kKinds = 24;

  /// Adds a row. If there are 64 like it now, returns and forgets them; they stay as they are until
  /// the next call. Else returns an empty span.
  std::span<const std::uint32_t> Add(const KernelJob& job, std::uint32_t row) {
    const RayF* floats = job.rays.floats();
    Kind& kind = kinds_[floats != nullptr ? KindOf(floats[row].direction)
                                          : KindOf(job.rays.doubles()[row].direction)];
    kind.row[kind.size++] = row;
    if (kind.size != FrustumRays::kRays) return {};
    kind.size = 0;
    return kind.row;
  }
  /// The rows of a kind that Add() has not returned.
  std::span<std::uint32_t> Rest(std::size_t kind) { return {kinds_[kind].row, kinds_[kind].size}; }
  /// Those, at least one, and copies of the last one: 64.
  std::span<const std::uint32_t> Filled(std::size_t kind) {
    Kind& filled = kinds_[kind];
    std::fill(filled.row + filled.size, std::end(filled.row), filled.row[filled.size - 1]);
    return filled.row;
  }

 private:
  struct Kind {
    std::uint32_t row[FrustumRays::kRays];
    std::size_t size = 0;
  };

  template <class Direction>
  KDRAY_INLINE static std::size_t KindOf(const Direction& d) {
    const auto x = std::fabs(d.x), y = std::fabs(d.y), z = std::fabs(d.z);
    const std::size_t largest = x >= y ? (x >= z ? 0 : 2) : (y >= z ? 1 : 2);
    return largest << 3 | static_cast<std::size_t>(d.x < 0) << 2 |
           static_cast<std::size_t>(d.y < 0) << 1 | static_cast<std::size_t>(d.z < 0);
  }

  Kind kinds_[kKinds];
};

}  // namespace kdray::core::KDRAY_ISA
KDRAY_END_ISA();
