// SPDX-License-Identifier: Apache-2.0
// Memory on huge pages. Traversal accesses memory at random; with 4 KiB pages, translating
// addresses takes a large part of its time.
#pragma once

#include <cstddef>
#include <new>
#include <type_traits>
#include <vector>

namespace kdray::core {

/// Aligned to a cache line; from 2 MiB on, aligned to a huge page and marked for huge pages (most
/// kernels use them only when advised to, and not always). Throws std::bad_alloc.
void* AllocateHuge(std::size_t bytes);
void FreeHuge(void* memory);

/// For std::vector. Elements constructed without a value stay uninitialised: many threads fill a
/// large vector, and zeroing it first on one thread would take as long.
template <class T>
struct HugePageAllocator {
  using value_type = T;
  static_assert(std::is_trivially_copyable_v<T>);

  HugePageAllocator() = default;
  template <class U>
  HugePageAllocator(const HugePageAllocator<U>&) {}  // NOLINT(google-explicit-constructor)

  T* allocate(std::size_t n) {
    if (n > static_cast<std::size_t>(-1) / 2 / sizeof(T)) throw std::bad_alloc();
    return static_cast<T*>(AllocateHuge(n * sizeof(T)));
  }
  void deallocate(T* memory, std::size_t) { FreeHuge(memory); }
  template <class U>
  void construct(U*) {}

  template <class U>
  friend bool operator==(const HugePageAllocator&, const HugePageAllocator<U>&) {
    return true;
  }
};

template <class T>
using HugeVector = std::vector<T, HugePageAllocator<T>>;

}  // namespace kdray::core
