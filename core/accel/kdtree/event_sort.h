// SPDX-License-Identifier: Apache-2.0
// Sorts the first events of a sweep.
#pragma once

#include <cstdint>
#include <vector>

#include "core/accel/kdtree/sweep_split.h"
#include "core/accel/primitive_ref.h"

namespace kdray::core {

/// Keeps its scratch memory: two events for each reference. For one thread at a time.
class EventSorter {
 public:
  /// Replaces *events by those of the references on one axis, sorted; a reference's slot is its
  /// number. O(n), with digits of eight bits.
  void Sort(std::span<const PrimitiveRef> references, int axis, std::vector<SplitEvent>* events);

 private:
  std::vector<SplitEvent> scratch_;
};

}  // namespace kdray::core
