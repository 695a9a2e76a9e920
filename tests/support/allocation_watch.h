// How much memory a piece of code takes.
#pragma once

#include <cstddef>

namespace kdray::test {

/// Counts what operator new gives to this thread while the object lives, less what is given back. A
/// program that uses it has the global operators replaced by counting ones. One at a time per
/// thread.
class AllocationWatch {
 public:
  AllocationWatch();
  ~AllocationWatch();
  AllocationWatch(const AllocationWatch&) = delete;
  AllocationWatch& operator=(const AllocationWatch&) = delete;

  /// The most bytes that were held at one time.
  std::size_t peak() const;
  /// Bytes held now.
  std::size_t held() const;
};

}  // namespace kdray::test
