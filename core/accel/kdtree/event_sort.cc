// SPDX-License-Identifier: Apache-2.0
#include "core/accel/kdtree/event_sort.h"

#include <array>
#include <cstddef>
#include <utility>

namespace kdray::core {

namespace {

constexpr std::size_t kDigits = 4;  // of a position
constexpr std::size_t kValues = 256;

std::size_t DigitOf(std::uint32_t position, std::size_t digit) {
  return position >> (8 * digit) & (kValues - 1);
}

}  // namespace

void EventSorter::Sort(std::span<const PrimitiveRef> references, int axis,
                       std::vector<SplitEvent>* events) {
  // First by kind and slot, which decide between equal positions, because sorting by a digit is
  // stable.
  using Kind = SplitEvent::Kind;
  events->clear();
  events->reserve(2 * references.size());
  const auto append = [&](Kind kind, auto position_of) {
    for (std::uint32_t slot = 0; slot < references.size(); ++slot) {
      const float low = references[slot].bounds.min[axis];
      const float high = references[slot].bounds.max[axis];
      if ((kind == Kind::kPlanar) == (low == high)) {
        events->emplace_back(position_of(low, high), kind, slot);
      }
    }
  };
  append(Kind::kEnd, [](float, float high) { return high; });
  if (events->size() < references.size())
    append(Kind::kPlanar, [](float low, float) { return low; });
  append(Kind::kStart, [](float low, float) { return low; });

  std::array<std::array<std::uint32_t, kValues>, kDigits> counts{};
  for (const SplitEvent& event : *events) {
    const std::uint32_t position = event.OrderedPosition();
    for (std::size_t digit = 0; digit < kDigits; ++digit) ++counts[digit][DigitOf(position, digit)];
  }
  scratch_.resize(events->size());
  for (std::size_t digit = 0; digit < kDigits; ++digit) {
    std::array<std::uint32_t, kValues>& places = counts[digit];
    std::uint32_t next = 0;
    for (std::uint32_t& place : places) next += std::exchange(place, next);
    for (const SplitEvent& event : *events) {
      scratch_[places[DigitOf(event.OrderedPosition(), digit)]++] = event;
    }
    events->swap(scratch_);
  }
}

}  // namespace kdray::core
