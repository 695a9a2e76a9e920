// How much memory a piece of code holds at its peak. Linking this replaces operator new and delete
// in the whole program, so only programs that use it pay for it.
#pragma once

#include <cstddef>
#include <cstdint>

namespace kdray::test {

/// Watches all threads from its construction on. One at a time.
class AllocationPeak {
 public:
  AllocationPeak();
  /// The most bytes that were allocated at once since then, above what there was at that time.
  std::uint64_t bytes() const;
  /// Bytes allocated now, above what there was at that time.
  std::uint64_t held() const;

 private:
  std::int64_t start_;
};

}  // namespace kdray::test
