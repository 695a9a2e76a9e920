// Memory for what a file claims to hold.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace kdray::core {

/// Room for `more` elements of a vector that is to hold `claimed` elements, a number that the file
/// states and its remaining bytes could hold. At first no more than twice the file's bytes are
/// taken, so that a lie costs no more than that; once that many elements were really there, room
/// for all, and never a doubling that leaves a part of it empty.
template <class T>
void MakeRoom(std::vector<T>& elements, std::uint64_t claimed, std::size_t file_bytes,
              std::uint64_t more = 1) {
  if (elements.size() + more <= elements.capacity()) return;
  constexpr std::uint64_t kSmall = 1024;
  const std::uint64_t modest = std::max<std::uint64_t>(kSmall + 2 * file_bytes / sizeof(T), more);
  elements.reserve(elements.empty() ? std::min(claimed, modest) : claimed);
}

}  // namespace kdray::core
