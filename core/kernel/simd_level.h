// Which vector instructions the kernels use. Answers do not depend on it.
#pragma once

#include <cstdint>
#include <span>
#include <string_view>

namespace kdray::core {

enum class SimdLevel : std::uint8_t {
  kBaseline,  ///< what every processor of the architecture has
  kAvx2,      ///< x86-64 with AVX2 and fused multiply-add
  kAvx512,    ///< x86-64 with AVX-512 F, VL, BW, DQ
};

/// "baseline", "avx2", "avx512".
std::string_view Name(SimdLevel level);

/// What this processor can do, the slowest first.
std::span<const SimdLevel> SupportedSimdLevels();
/// The last of them.
SimdLevel BestSimdLevel();

}  // namespace kdray::core
