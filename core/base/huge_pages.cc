// SPDX-License-Identifier: Apache-2.0
#include "core/base/huge_pages.h"

#include <sys/mman.h>

#include <cstdlib>

namespace kdray::core {

void* AllocateHuge(std::size_t bytes) {
  constexpr std::size_t kCacheLine = 64;
  constexpr std::size_t kHugePage = std::size_t{2} << 20;
  const std::size_t alignment = bytes >= kHugePage ? kHugePage : kCacheLine;
  const std::size_t rounded = (bytes + alignment - 1) / alignment * alignment;
  void* memory = std::aligned_alloc(alignment, rounded);
  if (memory == nullptr) throw std::bad_alloc();
  // Only advice: without free huge pages the kernel uses small ones.
  if (alignment == kHugePage) static_cast<void>(madvise(memory, rounded, MADV_HUGEPAGE));
  return memory;
}

void FreeHuge(void* memory) { std::free(memory); }

}  // namespace kdray::core
