// SPDX-License-Identifier: Apache-2.0
#include "server/release_pages.h"

#include <sys/mman.h>
#include <unistd.h>

#include <cstdint>

namespace kdray::server {

std::size_t ReleasePages(std::span<const char> bytes) {
  static const auto page = static_cast<std::uintptr_t>(sysconf(_SC_PAGESIZE));
  const auto begin = reinterpret_cast<std::uintptr_t>(bytes.data());
  const std::uintptr_t first = (begin + page - 1) / page * page;
  const std::uintptr_t last = (begin + bytes.size()) / page * page;
  if (first >= last) return 0;
  // The caller owns the bytes, so it may lose them; the system's interface has no const.
  if (madvise(reinterpret_cast<void*>(first), last - first, MADV_DONTNEED) != 0) return 0;
  return last - first;
}

}  // namespace kdray::server
