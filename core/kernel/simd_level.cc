// SPDX-License-Identifier: Apache-2.0
#include "core/kernel/simd_level.h"

#include <vector>

namespace kdray::core {

namespace {

std::vector<SimdLevel> Detect() {
  std::vector<SimdLevel> levels = {SimdLevel::kBaseline};
#ifdef __x86_64__
  __builtin_cpu_init();
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) {
    levels.push_back(SimdLevel::kAvx2);
    if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") &&
        __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512dq")) {
      levels.push_back(SimdLevel::kAvx512);
    }
  }
#endif
  return levels;
}

}  // namespace

std::string_view Name(SimdLevel level) {
  switch (level) {
    case SimdLevel::kBaseline:
      return "baseline";
    case SimdLevel::kAvx2:
      return "avx2";
    case SimdLevel::kAvx512:
      return "avx512";
  }
  return "";
}

std::span<const SimdLevel> SupportedSimdLevels() {
  static const std::vector<SimdLevel> levels = Detect();
  return levels;
}

SimdLevel BestSimdLevel() { return SupportedSimdLevels().back(); }

}  // namespace kdray::core
