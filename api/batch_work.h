// SPDX-License-Identifier: Apache-2.0
// What the work on a large batch asks of its caller: whether to go on, threads, and memory.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>

#include "api/should_stop.h"
#include "api/types.h"

namespace kdray::api {

/// Charges a number of bytes to the request: the problem if they are refused.
using ChargeBytes = std::function<Check(std::uint64_t bytes)>;

/// Calls piece(0) to piece(count - 1), perhaps from many threads at once, and waits for all.
using RunPieces =
    std::function<void(std::size_t count, const std::function<void(std::size_t)>& piece)>;

/// Empty functions: never stop, one thread, no limit.
struct BatchWork {
  ShouldStop should_stop;  ///< safe from many threads at once
  RunPieces run;
  ChargeBytes charge;
};

}  // namespace kdray::api
