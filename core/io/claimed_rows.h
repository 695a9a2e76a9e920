// SPDX-License-Identifier: Apache-2.0
// Memory for the elements that a file claims to contain.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace kdray::core {

/// Reserves room for `more` elements in a vector that is to have `claimed` elements, a number that
/// the file states and its remaining bytes could contain. At first it reserves at most twice the
/// file's bytes, so a false count costs no more. After that many elements were really present it
/// reserves room for all of them, so the vector never doubles and leaves a part unused.
template <class T>
void MakeRoom(std::vector<T>& elements, std::uint64_t claimed, std::size_t file_bytes,
              std::uint64_t more = 1) {
  if (elements.size() + more <= elements.capacity()) return;
  constexpr std::uint64_t kSmall = 1024;
  const std::uint64_t modest = std::max<std::uint64_t>(kSmall + 2 * file_bytes / sizeof(T), more);
  elements.reserve(elements.empty() ? std::min(claimed, modest) : claimed);
}

}  // namespace kdray::core
