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

/// A value is 0 if the system does not tell it. Lists the open descriptors: some thousands of them
/// take a millisecond.
ProcessValues ReadProcessValues();

}  // namespace kdray::server
