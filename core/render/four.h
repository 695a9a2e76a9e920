// SPDX-License-Identifier: Apache-2.0
// Vectors of 16 bytes, which every processor of our architectures has. The operators work on
// each element, so results are those of the scalar operations.
#pragma once

#include <cstdint>

namespace kdray::core {

using FourFloats = float __attribute__((vector_size(16)));
using FourInts = std::int32_t __attribute__((vector_size(16)));
using FourWords = std::uint32_t __attribute__((vector_size(16)));
using TwoDoubles = double __attribute__((vector_size(16)));

}  // namespace kdray::core
