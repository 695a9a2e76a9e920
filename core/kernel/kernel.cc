// SPDX-License-Identifier: Apache-2.0
#include "core/kernel/kernel.h"

namespace kdray::core {

namespace isa_baseline {
KernelFunction Find(KernelKind kernel, Precision precision, bool double_vertices, RayQuery query);
}
#ifdef __x86_64__
namespace isa_avx2 {
KernelFunction Find(KernelKind kernel, Precision precision, bool double_vertices, RayQuery query);
}
namespace isa_avx512 {
KernelFunction Find(KernelKind kernel, Precision precision, bool double_vertices, RayQuery query);
}
#endif

std::string_view Name(KernelKind kernel) {
  switch (kernel) {
    case KernelKind::kInterleaved:
      return "interleaved";
    case KernelKind::kStream:
      return "stream";
    case KernelKind::kFrustum:
      return "frustum";
  }
  return "";
}

KernelFunction FindKernel(SimdLevel level, KernelKind kernel, Precision precision,
                          bool double_vertices, RayQuery query) {
  switch (level) {
    case SimdLevel::kBaseline:
      break;
#ifdef __x86_64__
    case SimdLevel::kAvx2:
      return isa_avx2::Find(kernel, precision, double_vertices, query);
    case SimdLevel::kAvx512:
      return isa_avx512::Find(kernel, precision, double_vertices, query);
#else
    case SimdLevel::kAvx2:
    case SimdLevel::kAvx512:
      break;
#endif
  }
  return isa_baseline::Find(kernel, precision, double_vertices, query);
}

}  // namespace kdray::core
