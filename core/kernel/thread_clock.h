// SPDX-License-Identifier: Apache-2.0
// The clock that trials of kernels compare.
#pragma once

#include <ctime>

namespace kdray::core {

/// Seconds of processor time of this thread, so that other load of the machine decides nothing.
inline double ThreadSeconds() {
  timespec t;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

}  // namespace kdray::core
