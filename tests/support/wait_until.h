// SPDX-License-Identifier: Apache-2.0
// Waits for what another thread or process does, where nothing notifies the test.
#pragma once

#include <chrono>
#include <thread>

namespace kdray::test {

/// Looks every millisecond; true as soon as `condition()` is, false if it is not within `limit`.
template <class Condition>
[[nodiscard]] bool WaitUntil(const Condition& condition,
                             std::chrono::steady_clock::duration limit = std::chrono::seconds(10)) {
  const auto deadline = std::chrono::steady_clock::now() + limit;
  while (!condition()) {
    if (std::chrono::steady_clock::now() >= deadline) return condition();
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return true;
}

}  // namespace kdray::test
