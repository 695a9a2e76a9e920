// SPDX-License-Identifier: Apache-2.0
// Cuts at the ends of the references: all that can be best.
#pragma once

#include <bit>
#include <compare>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "core/accel/kdtree/split.h"
#include "core/base/float4.h"

namespace kdray::core {

/// Where a reference ends, lies flat or starts on one axis. Between two neighbouring events the SAH
/// cost changes linearly with the plane, so the best plane is at one of them. An integer inside, to
/// be sorted fast: by position, then kind, then slot. Source: Wald and Havran 2006, section 4.2.
class SplitEvent {
 public:
  /// In this order at one position.
  enum class Kind : std::uint32_t { kEnd = 0, kPlanar = 1, kStart = 2 };
  static constexpr std::uint32_t kMaxSlot = (1u << 30) - 1;

  SplitEvent() = default;
  /// `slot` is the builder's number of the reference. -0 counts as +0.
  SplitEvent(float position, Kind kind, std::uint32_t slot)
      : key_(std::uint64_t{Ordered(position)} << 32 | static_cast<std::uint32_t>(kind) << 30 |
             slot) {}

  float position() const {
    const std::uint32_t ordered = OrderedPosition();
    return std::bit_cast<float>(ordered ^ (ordered & kSign ? kSign : ~std::uint32_t{0}));
  }
  Kind kind() const { return static_cast<Kind>(key_ >> 30 & 3u); }
  std::uint32_t slot() const { return static_cast<std::uint32_t>(key_) & kMaxSlot; }
  /// Grows with the position.
  std::uint32_t OrderedPosition() const { return static_cast<std::uint32_t>(key_ >> 32); }

  friend auto operator<=>(const SplitEvent&, const SplitEvent&) = default;

  /// Four events side by side.
  class Four {
   public:
    explicit Four(const SplitEvent* events) {
      static_assert(sizeof(SplitEvent) == 8 && std::endian::native == std::endian::little);
      const Int4 first = std::bit_cast<Int4>(Load4(events));
      const Int4 second = std::bit_cast<Int4>(Load4(events + 2));
      low_ = __builtin_shufflevector(first, second, 0, 2, 4, 6);
      high_ = __builtin_shufflevector(first, second, 1, 3, 5, 7);
    }
    Float4 positions() const {
      constexpr std::int32_t kSignBit = std::numeric_limits<std::int32_t>::min();
      return std::bit_cast<Float4>(high_ ^ (~(high_ >> 31) | kSignBit));
    }
    /// -1 where it is one; 0 elsewhere.
    Int4 are_starts() const { return low_ >> 31; }

   private:
    Int4 low_, high_;  // halves of the keys
  };

 private:
  static constexpr std::uint32_t kSign = 0x80000000u;
  // Positive floats are ordered like their bits, negative ones the other way round.
  static std::uint32_t Ordered(float position) {
    const std::uint32_t bits = std::bit_cast<std::uint32_t>(position + 0.0f);
    return bits ^ (bits & kSign ? ~std::uint32_t{0} : kSign);
  }

  std::uint64_t key_ = 0;
};

/// Writes the events of an interval, one or two, and returns how many.
inline std::size_t MakeEvents(float low, float high, std::uint32_t slot, SplitEvent* events) {
  if (low == high) {
    events[0] = SplitEvent(low, SplitEvent::Kind::kPlanar, slot);
    return 1;
  }
  events[0] = SplitEvent(low, SplitEvent::Kind::kStart, slot);
  events[1] = SplitEvent(high, SplitEvent::Kind::kEnd, slot);
  return 2;
}

/// SahCost::Subtree for 0 to `most` triangles. A table, since a sweep asks for each event.
std::vector<double> SubtreeCosts(const SahCost& cost, std::size_t most);

/// Shows `search` the best of the cuts at all events of one axis. The events are sorted and belong
/// to `triangles` references; `costs` reaches so far. O(events).
void SweepAxis(std::span<const SplitEvent> events, int axis, std::size_t triangles,
               std::span<const double> costs, SplitSearch* search);

}  // namespace kdray::core
