// SPDX-License-Identifier: Apache-2.0
// Measures the peak memory of a piece of code. Linking this replaces operator new and delete in the
// whole program, so only programs that use it pay for it.
#pragma once

#include <cstddef>
#include <cstdint>

namespace kdray::test {

/// Counts the allocations of all threads from its construction on. One object at a time.
class AllocationPeak {
 public:
  AllocationPeak();
  /// The peak of allocated bytes since the construction, minus those at the construction.
  std::uint64_t bytes() const;
  /// Bytes allocated now, minus those at the construction.
  std::uint64_t held() const;

 private:
  std::int64_t start_;
};

}  // namespace kdray::test
