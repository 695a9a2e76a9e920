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

  /// The kinds of 64 rows, from `first` on.
  struct Kinds {
    std::uint32_t of[FrustumRays::kRays];

    Kinds(const KernelJob& job, std::size_t first) {
      const RayF* floats = job.rays.floats();
      for (std::size_t i = 0; i < FrustumRays::kRays; i += 4) {
        if (floats == nullptr) {
          for (std::size_t k = i; k < i + 4; ++k) {
            of[k] = KindOf(job.rays.doubles()[RowAt(job, first + k)].direction);
          }
          continue;
        }
        F4 d[4];
        for (std::size_t k = 0; k < 4; ++k) {
          __builtin_memcpy(&d[k], &floats[RowAt(job, first + i + k)].direction, sizeof(d[k]));
        }
        Transpose4(d);
        const U4 kinds = KindsOf(d[0], d[1], d[2]);
        __builtin_memcpy(of + i, &kinds, sizeof(kinds));
      }
    }
  };

  /// Adds a row of a kind. If there are 64 of it now, returns and forgets them; they stay as they
  /// are until the next call. Else returns an empty span.
  KDRAY_INLINE std::span<const std::uint32_t> Add(std::size_t its_kind, std::uint32_t row) {
    Kind& kind = kinds_[its_kind];
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

  KDRAY_INLINE static std::uint32_t KindOf(const Vec3d& d) {
    const double x = std::fabs(d.x), y = std::fabs(d.y), z = std::fabs(d.z);
    const std::uint32_t largest = x >= y ? (x >= z ? 0 : 2) : (y >= z ? 1 : 2);
    return largest << 3 | static_cast<std::uint32_t>(d.x < 0) << 2 |
           static_cast<std::uint32_t>(d.y < 0) << 1 | static_cast<std::uint32_t>(d.z < 0);
  }
  // The same of four directions.
  KDRAY_INLINE static U4 KindsOf(F4 x, F4 y, F4 z) {
    const F4 zero = {};
    const U4 signs = (U4(x < zero) & 4u) | (U4(y < zero) & 2u) | (U4(z < zero) & 1u);
    const F4 a = Abs(x), b = Abs(y), c = Abs(z);
    const U4 is_x = U4(a >= b) & U4(a >= c);
    const U4 is_y = ~U4(a >= b) & U4(b >= c);
    return (is_y & 8u) | (~(is_x | is_y) & 16u) | signs;
  }

  Kind kinds_[kKinds];
};

}  // namespace kdray::core::KDRAY_ISA
KDRAY_END_ISA();
