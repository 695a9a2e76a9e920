// Memory on huge pages: traversal touches memory at random, and with 4 KiB pages a good part of its
// time goes to looking up addresses.
#pragma once

#include <cstddef>
#include <new>
#include <type_traits>
#include <vector>

namespace kdray::core {

/// Aligned to a cache line, and from 2 MiB on to a huge page, which the kernel is then asked for
/// (it gives them only when asked, on most systems, and not always). Throws std::bad_alloc.
void* AllocateHuge(std::size_t bytes);
void FreeHuge(void* memory);

/// For std::vector. Elements made without a value have none until they are written: a large vector
/// is filled by many threads, and to fill it first on one would take as long.
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
