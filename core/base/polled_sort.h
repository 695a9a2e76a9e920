// SPDX-License-Identifier: Apache-2.0
// Sorting that can be cancelled, for lists whose length depends on the input.
#pragma once

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <utility>
#include <vector>

#include "core/base/cancel_poll.h"

namespace kdray::core {

// A comparison, or a step over one value, counts as `work` (CancelPoll). All functions return false
// when the poll has stopped; the values are then in any order, and some may be moved from.

/// Moves the first `keep` values by `less` to the front, in order; the other values are unspecified
/// afterwards. O(n log n) comparisons, and a second list of the same size.
template <class T, class Less>
bool PolledPartialSort(std::span<T> values, std::size_t keep, std::uint64_t work, CancelPoll* poll,
                       const Less& less);

/// std::sort with a poll. The order of equal values depends on the values alone.
template <class T, class Less = std::less<>>
bool PolledSort(std::span<T> values, std::uint64_t work, CancelPoll* poll, const Less& less = {}) {
  return PolledPartialSort(values, values.size(), work, poll, less);
}

/// std::sort with a poll and without a second list; several times slower for long lists.
template <class T, class Less = std::less<>>
bool PolledSortInPlace(std::span<T> values, std::uint64_t work, CancelPoll* poll,
                       const Less& less = {});

/// std::partition with a poll. *first_false is the index of the first value for which `is_first` is
/// false.
template <class T, class IsFirst>
bool PolledPartition(std::span<T> values, std::uint64_t work, CancelPoll* poll,
                     const IsFirst& is_first, std::size_t* first_false);

/// std::nth_element with a poll; n < values.size().
template <class T, class Less = std::less<>>
bool PolledNthElement(std::span<T> values, std::size_t n, std::uint64_t work, CancelPoll* poll,
                      const Less& less = {});

// ---- Implementation ----

template <class T, class Less>
bool PolledPartialSort(std::span<T> values, std::size_t keep, std::uint64_t work, CancelPoll* poll,
                       const Less& less) {
  // Sorts pieces that fit between two checks of the token, then merges them bottom up. Only the
  // first `keep` values of a run matter, so a merge writes only these.
  const auto piece = static_cast<std::size_t>(
      std::bit_floor(std::clamp<std::uint64_t>((1 << 16) / work, 16, 1 << 14)));
  const std::size_t size = values.size();
  keep = std::min(keep, size);
  for (std::size_t first = 0; first < size; first += piece) {
    const std::span<T> some = values.subspan(first, std::min(piece, size - first));
    if (poll->Spend(some.size() * work * static_cast<std::uint64_t>(std::bit_width(some.size())))) {
      return false;
    }
    std::sort(some.begin(), some.end(), less);
  }
  if (size <= piece) return true;

  std::vector<T> scratch(size);
  std::span<T> from = values, to = scratch;
  for (std::size_t run = piece; run < size; run *= 2) {
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
  if (from.data() == values.data()) return true;
  return PolledLoop(keep, work, poll, [&](std::size_t i) { values[i] = std::move(from[i]); });
}

template <class T, class Less>
bool PolledSortInPlace(std::span<T> values, std::uint64_t work, CancelPoll* poll,
                       const Less& less) {
  constexpr std::size_t kSmall = std::size_t{1} << 14;
  const auto levels = static_cast<std::uint64_t>(std::bit_width(values.size()));
  if (values.size() <= kSmall) {
    if (poll->Spend(values.size() * work * levels)) return false;
    std::sort(values.begin(), values.end(), less);
    return true;
  }
  // Heapsort: each step is O(log n).
  for (std::size_t size = 2; size <= values.size(); ++size) {
    if (poll->Spend(work)) return false;
    const std::span<T> heap = values.first(size);
    std::push_heap(heap.begin(), heap.end(), less);
  }
  for (std::size_t size = values.size(); size > 1; --size) {
    if (poll->Spend(work * levels)) return false;
    const std::span<T> heap = values.first(size);
    std::pop_heap(heap.begin(), heap.end(), less);
  }
  return true;
}

template <class T, class IsFirst>
bool PolledPartition(std::span<T> values, std::uint64_t work, CancelPoll* poll,
                     const IsFirst& is_first, std::size_t* first_false) {
  std::size_t first = 0, last = values.size();
  for (;;) {
    for (; first < last && is_first(values[first]); ++first) {
      if (poll->Spend(work)) return false;
    }
    for (; first < last && !is_first(values[last - 1]); --last) {
      if (poll->Spend(work)) return false;
    }
    if (first == last) break;
    std::swap(values[first++], values[--last]);
  }
  *first_false = first;
  return true;
}

template <class T, class Less>
bool PolledNthElement(std::span<T> values, std::size_t n, std::uint64_t work, CancelPoll* poll,
                      const Less& less) {
  // Quickselect, until std::nth_element is quick enough. The pivot is the median of a sample from
  // the whole list. If an input defeats that, the list is sorted.
  constexpr std::size_t kSmall = std::size_t{1} << 15;
  constexpr std::size_t kSample = 255;
  for (int round = 0; values.size() > kSmall; ++round) {
    if (round == 64) return PolledSort(values, work, poll, less);
    std::vector<T> sample;
    for (std::size_t i = 0; i < kSample; ++i) {
      sample.push_back(values[i * (values.size() / kSample)]);
    }
    std::nth_element(sample.begin(), sample.begin() + kSample / 2, sample.end(), less);
    const T pivot = sample[kSample / 2];
    std::size_t below = 0, not_above = 0;  // values less than the pivot; and those equal to it too
    if (!PolledPartition(
            values, work, poll, [&](const T& value) { return less(value, pivot); }, &below)) {
      return false;
    }
    if (n < below) {
      values = values.first(below);
      continue;
    }
    if (!PolledPartition(
            values.subspan(below), work, poll, [&](const T& value) { return !less(pivot, value); },
            &not_above)) {
      return false;
    }
    if (n < below + not_above) return true;
    values = values.subspan(below + not_above);
    n -= below + not_above;
  }
  if (poll->Spend(values.size() * work)) return false;
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(n), values.end(),
                   less);
  return true;
}

}  // namespace kdray::core
