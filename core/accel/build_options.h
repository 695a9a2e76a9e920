// SPDX-License-Identifier: Apache-2.0
// Options of every builder.
#pragma once

#include "core/base/cancel.h"
#include "core/base/progress.h"

namespace kdray::core {

struct BuildOptions {
  CancelToken cancel;            ///< a stopped build returns nothing
  Progress* progress = nullptr;  ///< may be null; reaches 1 at the end
};

}  // namespace kdray::core
