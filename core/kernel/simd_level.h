// SPDX-License-Identifier: Apache-2.0
// The vector instructions of the kernels. Answers do not depend on them.
#pragma once

#include <cstdint>
#include <span>
#include <string_view>

namespace kdray::core {

enum class SimdLevel : std::uint8_t {
  kBaseline,  ///< every processor of the architecture
  kAvx2,      ///< x86-64 with AVX2 and fused multiply-add
  kAvx512,    ///< x86-64 with AVX-512 F, VL, BW, DQ
};

/// "baseline", "avx2", "avx512".
std::string_view Name(SimdLevel level);

/// The levels that this processor supports, slowest first.
std::span<const SimdLevel> SupportedSimdLevels();
/// The fastest supported level.
SimdLevel BestSimdLevel();

}  // namespace kdray::core
