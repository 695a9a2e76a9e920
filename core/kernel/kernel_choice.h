// SPDX-License-Identifier: Apache-2.0
// Chooses the kernel of a batch.
#pragma once

#include <cstddef>
#include <optional>

#include "core/kernel/kernel.h"
#include "core/kernel/kernel_kind.h"
#include "core/kernel/simd_level.h"

namespace kdray::core {

/// A caller's choices in place of those by rays and processor (TraceOptions).
struct KernelOverrides {
  std::optional<KernelKind> kernel = {};
  std::optional<SimdLevel> simd = {};
  std::optional<bool> sort = {};
};

/// Fills in the choices by the job's tree, rays and precision, and by the processor.
void ChooseKernel(const KernelOverrides& overrides, KernelJob* job);

/// Traces rows [first, last) with the chosen kernel. When job.cancel stops it, sets *job.stopped;
/// does nothing if that is set.
void TraceBlock(const KernelJob& job, std::size_t first, std::size_t last);

}  // namespace kdray::core
