// SPDX-License-Identifier: Apache-2.0
// What a ray query answers.
#pragma once

#include <cstdint>
#include <limits>

namespace kdray::core {

/// 0-based number of a triangle in file order.
using PrimitiveId = std::uint32_t;
inline constexpr PrimitiveId kNoPrimitive = 0xffffffffu;

/// One row of a batch's answer. A miss has primitive_id == kNoPrimitive and t = infinity. An
/// invalid ray (IsValid) is a miss with t = NaN. The numbers of a hit are finite and never -0; a t
/// beyond the range of double is the largest finite double.
struct Hit {
  double t = std::numeric_limits<double>::infinity();  ///< in lengths of the ray's direction
  double u = 0;  ///< weight of the triangle's second vertex, 0..1
  double v = 0;  ///< weight of its third vertex, 0..1; the first has 1 - u - v
  PrimitiveId primitive_id = kNoPrimitive;

  bool IsHit() const { return primitive_id != kNoPrimitive; }
  friend bool operator==(const Hit&, const Hit&) = default;
};

/// The order of hits: smallest t first, then smallest primitive_id. It depends neither on the build
/// nor on the number of threads.
inline bool Closer(double t_a, PrimitiveId id_a, double t_b, PrimitiveId id_b) {
  return t_a < t_b || (t_a == t_b && id_a < id_b);
}

}  // namespace kdray::core
