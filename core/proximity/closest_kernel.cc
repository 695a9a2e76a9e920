// SPDX-License-Identifier: Apache-2.0
#include "core/proximity/closest_kernel.h"

namespace kdray::core {

namespace isa_baseline {
PointKernels FindForPoints(bool double_vertices);
}
#ifdef __x86_64__
namespace isa_avx2 {
PointKernels FindForPoints(bool double_vertices);
}
namespace isa_avx512 {
PointKernels FindForPoints(bool double_vertices);
}
#endif

PointKernels FindPointKernels(SimdLevel level, bool double_vertices) {
  switch (level) {
    case SimdLevel::kBaseline:
      break;
#ifdef __x86_64__
    case SimdLevel::kAvx2:
      return isa_avx2::FindForPoints(double_vertices);
    case SimdLevel::kAvx512:
      return isa_avx512::FindForPoints(double_vertices);
#else
    case SimdLevel::kAvx2:
    case SimdLevel::kAvx512:
      break;
#endif
  }
  return isa_baseline::FindForPoints(double_vertices);
}

}  // namespace kdray::core
