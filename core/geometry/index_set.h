// SPDX-License-Identifier: Apache-2.0
// A set of small numbers that finds its next member quickly.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

namespace kdray::core {

/// A subset of 0 .. n - 1 as bits. Each level above the lowest has one bit for each nonzero word of
/// the level below. Every operation takes O(log n) with base 64.
class IndexSet {
 public:
  /// Sets *this to the empty subset of 0 .. n - 1.
  void Reset(std::size_t n) {
    std::size_t used = 0;
    do {
      n = (n + 63) / 64;
      if (used == levels_.size()) levels_.emplace_back();
      levels_[used++].assign(n, 0);
    } while (n > 1);
    levels_.resize(used);
  }

  void Insert(std::uint32_t i) {
    for (auto& level : levels_) {
      level[i / 64] |= std::uint64_t{1} << (i % 64);
      i /= 64;
    }
  }

  void Erase(std::uint32_t i) {
    for (auto& level : levels_) {
      level[i / 64] &= ~(std::uint64_t{1} << (i % 64));
      if (level[i / 64] != 0) return;
      i /= 64;
    }
  }

  /// The first member from `start` on, else the first of all; nullopt when the set is empty.
  std::optional<std::uint32_t> NextFrom(std::uint32_t start) const {
    if (levels_.back()[0] == 0) return std::nullopt;
    const std::optional<std::uint32_t> found = AtLeast(start);
    return found ? found : AtLeast(0);
  }

 private:
  std::optional<std::uint32_t> AtLeast(std::uint32_t start) const {
    // Goes up to a word that has a member at or after the place, then down to its lowest member.
    std::size_t k = 0;
    std::size_t i = start;
    for (;; ++k) {
      if (k == levels_.size() || i / 64 >= levels_[k].size()) return std::nullopt;
      const std::uint64_t rest = levels_[k][i / 64] >> (i % 64);
      if (rest != 0) {
        i += static_cast<std::size_t>(std::countr_zero(rest));
        break;
      }
      i = i / 64 + 1;
    }
    for (; k > 0; --k) i = i * 64 + static_cast<std::size_t>(std::countr_zero(levels_[k - 1][i]));
    return static_cast<std::uint32_t>(i);
  }

  std::vector<std::vector<std::uint64_t>> levels_ = {{0}};
};

}  // namespace kdray::core
