// SPDX-License-Identifier: Apache-2.0
// Checks that this thread's floating-point unit follows the rules on which core's answers depend.
#pragma once

#include "core/base/result.h"

namespace kdray::core {

/// kInternal when results too small for a normal number are flushed to zero (FTZ), when such
/// operands are read as zero (DAZ), or when rounding is not to nearest. Some libraries and compiler
/// options set these for a whole process. The check computes in float and in double on the calling
/// thread.
Status CheckFloatingPointEnvironment();

}  // namespace kdray::core
