// SPDX-License-Identifier: Apache-2.0
// Huge pages for memory of another allocator; core/base/huge_pages.h has one of its own.
#pragma once

#include <cstddef>

namespace kdray::core {

/// Asks the kernel to use huge pages for the whole ones within the block, when they are first
/// touched. Only advice, without effect on the contents: a large block that is filled once takes
/// less time, because the kernel is called for each 2 MiB and not for each 4 KiB.
void AdviseHuge(void* memory, std::size_t bytes);

}  // namespace kdray::core
