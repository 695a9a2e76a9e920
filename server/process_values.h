// SPDX-License-Identifier: Apache-2.0
// What the operating system says about this process, for GET /metrics.
#pragma once

#include <cstdint>

namespace kdray::server {

struct ProcessValues {
  std::uint64_t resident_bytes = 0;  ///< its pages in memory
  double cpu_seconds = 0;            ///< of all its threads, user and system
  std::uint64_t open_descriptors = 0;
  std::uint64_t max_descriptors = 0;  ///< the limit for them
};

/// A value that cannot be read is 0. Lists the open descriptors, so it takes a millisecond for some
/// thousands.
ProcessValues ReadProcessValues();

}  // namespace kdray::server
