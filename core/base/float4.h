// SPDX-License-Identifier: Apache-2.0
// Four floats at once. The vector types of GCC and Clang: each lane is computed by the plain IEEE
// operation, in the order written, on every processor. So results do not depend on the machine.
#pragma once

#include <cstdint>
#include <cstring>

namespace kdray::core {

using Float4 = float __attribute__((vector_size(16)));
using Int4 = std::int32_t __attribute__((vector_size(16)));
using Unsigned4 = std::uint32_t __attribute__((vector_size(16)));

/// From 16 bytes at any address.
inline Float4 Load4(const void* from) {
  Float4 v;
  std::memcpy(&v, from, sizeof v);
  return v;
}
inline Float4 Fill4(float x) { return Float4{x, x, x, x}; }
/// b where the comparison is unordered (NaN).
inline Float4 Min4(Float4 a, Float4 b) { return a < b ? a : b; }
inline Float4 Max4(Float4 a, Float4 b) { return a > b ? a : b; }
inline Int4 Truncate4(Float4 v) { return __builtin_convertvector(v, Int4); }
inline Float4 ToFloat4(Int4 v) { return __builtin_convertvector(v, Float4); }

}  // namespace kdray::core
