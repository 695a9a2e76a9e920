// Which engine takes which rays.
#pragma once

#include <cstddef>

#include "core/trace/engine/engine.h"
#include "core/trace/trace.h"

namespace kdray::core {

/// Fills in what the job's tree, precision and processor decide.
void ChooseEngines(const TraceOptions& options, EngineJob* job);

/// Traces rows [first, last) by the engines that suit them, until job.cancel stops it: then sets
/// *job.stopped, and does nothing once that is set.
void TraceBlock(const EngineJob& job, std::size_t first, std::size_t last);

}  // namespace kdray::core
