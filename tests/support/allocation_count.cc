// SPDX-License-Identifier: Apache-2.0
#include "tests/support/allocation_count.h"

#include <malloc.h>

#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <new>

namespace {

std::atomic<std::int64_t> held{0};
std::atomic<std::int64_t> peak{0};

void* Allocate(std::size_t size, std::size_t alignment) {
  void* block = alignment <= alignof(std::max_align_t)
                    ? std::malloc(std::max<std::size_t>(size, 1))
                    : std::aligned_alloc(alignment, (size + alignment - 1) / alignment * alignment);
  if (block == nullptr) throw std::bad_alloc();
  const std::int64_t bytes = static_cast<std::int64_t>(malloc_usable_size(block));
  const std::int64_t now = held.fetch_add(bytes, std::memory_order_relaxed) + bytes;
  std::int64_t seen = peak.load(std::memory_order_relaxed);
  while (seen < now && !peak.compare_exchange_weak(seen, now, std::memory_order_relaxed)) {
  }
  return block;
}

void Free(void* block) {
  if (block == nullptr) return;
  held.fetch_sub(static_cast<std::int64_t>(malloc_usable_size(block)), std::memory_order_relaxed);
  std::free(block);
}

}  // namespace

// The other forms of operator new and delete call these.
void* operator new(std::size_t size) { return Allocate(size, 0); }
void* operator new(std::size_t size, std::align_val_t alignment) {
  return Allocate(size, static_cast<std::size_t>(alignment));
}
void operator delete(void* block) noexcept { Free(block); }
void operator delete(void* block, std::size_t) noexcept { Free(block); }
void operator delete(void* block, std::align_val_t) noexcept { Free(block); }
void operator delete(void* block, std::size_t, std::align_val_t) noexcept { Free(block); }

namespace kdray::test {

AllocationPeak::AllocationPeak() : start_(::held.load()) { peak.store(start_); }

std::uint64_t AllocationPeak::bytes() const {
  return static_cast<std::uint64_t>(std::max<std::int64_t>(0, peak.load() - start_));
}

std::uint64_t AllocationPeak::held() const {
  return static_cast<std::uint64_t>(std::max<std::int64_t>(0, ::held.load() - start_));
}

}  // namespace kdray::test
