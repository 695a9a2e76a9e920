// Which kernel takes which rays.
#pragma once

#include <cstddef>
#include <optional>

#include "core/kernel/kernel.h"
#include "core/kernel/kernel_kind.h"
#include "core/kernel/simd_level.h"

namespace kdray::core {

/// What a caller decides instead of the rays and the processor (TraceOptions).
struct KernelOverrides {
  std::optional<KernelKind> kernel = {};
  std::optional<SimdLevel> simd = {};
  std::optional<bool> sort = {};
};

/// Fills in what the job's tree, rays and precision and the processor decide.
void ChooseKernel(const KernelOverrides& overrides, KernelJob* job);

/// Traces rows [first, last) by the kernels that suit them, until job.cancel stops it: then sets
/// *job.stopped, and does nothing once that is set.
void TraceBlock(const KernelJob& job, std::size_t first, std::size_t last);

}  // namespace kdray::core
