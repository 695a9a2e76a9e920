// Memory for what a file claims to hold.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace kdray::core {

/// Room for one more element of a vector that is to hold `claimed` elements, a number that the file
/// states and its remaining bytes could hold. At first no more than twice the file's bytes are
/// taken, so that a lie costs no more than that; once so many elements were really there, room for
/// all, and never a doubling that leaves a part of it empty.
template <class T>
void MakeRoom(std::vector<T>& elements, std::uint64_t claimed, std::size_t file_bytes) {
  if (elements.size() < elements.capacity()) return;
  const std::uint64_t modest = std::max<std::uint64_t>(2 * file_bytes / sizeof(T), 1);
  elements.reserve(elements.empty() ? std::min(claimed, modest) : claimed);
}

}  // namespace kdray::core
