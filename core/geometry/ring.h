// SPDX-License-Identifier: Apache-2.0
// A closed path of corners as a doubly linked ring, from which corners can be taken out.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/geometry/predicates.h"

namespace kdray::core {

/// Edge i of a ring runs from corner i to its next one. The points must outlive the ring's use.
class Ring {
 public:
  void Reset(std::span<const Point2> points) {
    points_ = points;
    const auto n = static_cast<std::uint32_t>(points.size());
    links_.resize(n);
    for (std::uint32_t i = 0; i < n; ++i) {
      links_[i] = {i == 0 ? n - 1 : i - 1, i + 1 == n ? 0 : i + 1};
    }
  }

  std::size_t size() const { return links_.size(); }
  Point2 point(std::uint32_t i) const { return points_[i]; }
  std::uint32_t previous(std::uint32_t i) const { return links_[i].previous; }
  std::uint32_t next(std::uint32_t i) const { return links_[i].next; }

  /// Links the corners before and after corner i; its own links stay.
  void Remove(std::uint32_t i) {
    links_[links_[i].previous].next = links_[i].next;
    links_[links_[i].next].previous = links_[i].previous;
  }

 private:
  struct Links {
    std::uint32_t previous, next;
  };
  std::span<const Point2> points_;
  std::vector<Links> links_;
};

}  // namespace kdray::core
