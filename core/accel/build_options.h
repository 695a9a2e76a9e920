// What every builder takes besides the mesh.
#pragma once

#include "core/base/cancel.h"
#include "core/base/progress.h"

namespace kdray::core {

struct BuildOptions {
  CancelToken cancel;            ///< a stopped build leaves nothing behind
  Progress* progress = nullptr;  ///< may be null; reaches 1 at the end
};

}  // namespace kdray::core
