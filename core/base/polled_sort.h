// Sorting that can be interrupted: for lists whose length the input decides.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <utility>
#include <vector>

#include "core/base/cancel_poll.h"

namespace kdray::core {

/// Brings the first `keep` of the values by `less` to the front, in order; the others are anything
/// afterwards. Equal values keep their order. O(n log keep) comparisons, each counted as `work`
/// (CancelPoll). False when the poll has stopped; the values are then anything.
template <class T, class Less>
bool PolledPartialSort(std::span<T> values, std::size_t keep, std::uint64_t work, CancelPoll* poll,
                       const Less& less);

/// std::stable_sort with a poll.
template <class T, class Less = std::less<>>
bool PolledSort(std::span<T> values, std::uint64_t work, CancelPoll* poll, const Less& less = {}) {
  return PolledPartialSort(values, values.size(), work, poll, less);
}

// ---- Implementation ----

template <class T, class Less>
bool PolledPartialSort(std::span<T> values, std::size_t keep, std::uint64_t work, CancelPoll* poll,
                       const Less& less) {
  // Bottom-up merge sort: short runs by insertion, then merged in pairs. Of a run no more than
  // `keep` values matter, so that is all that a merge makes of it.
  constexpr std::size_t kRun = 16;
  const std::size_t size = values.size();
  keep = std::min(keep, size);
  for (std::size_t first = 0; first < size; first += kRun) {
    const std::size_t last = std::min(first + kRun, size);
    if (poll->Spend((last - first) * work * 4)) return false;
    for (std::size_t i = first + 1; i < last; ++i) {
      T value = std::move(values[i]);
      std::size_t at = i;
      for (; at > first && less(value, values[at - 1]); --at) values[at] = std::move(values[at - 1]);
      values[at] = std::move(value);
    }
  }
  if (size <= kRun) return true;

  std::vector<T> scratch(size);
  std::span<T> from = values, to = scratch;
  for (std::size_t run = kRun; run < size; run *= 2) {
    for (std::size_t first = 0; first < size; first += 2 * run) {
      const std::size_t middle = std::min(first + run, size);
      const std::size_t end = std::min(first + 2 * run, size);
      const std::size_t a_end = std::min(first + keep, middle);
      const std::size_t b_end = std::min(middle + keep, end);
      std::size_t a = first, b = middle;
      for (std::size_t i = first; i < std::min(first + keep, end); ++i) {
        if (poll->Spend(work)) return false;
        const bool take_b = a == a_end || (b < b_end && less(from[b], from[a]));
        to[i] = std::move(from[take_b ? b++ : a++]);
      }
    }
    std::swap(from, to);
  }
  if (from.data() != values.data()) std::move(from.begin(), from.end(), values.begin());
  return true;
}

}  // namespace kdray::core
