// SPDX-License-Identifier: Apache-2.0
// The order of those that wait for memory. Only the rule: core/library/memory_budget.h has the
// memory and the threads.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <list>
#include <optional>

namespace kdray::core {

/// A waiter takes free memory whenever it fits, so small work passes large work that waits. Large
/// work gets turns: the waiter that has waited longest, and at least `patience`, gets a turn of
/// `turn`, during which no other takes memory, so returned memory adds up for it. If a turn was not
/// enough, the next waiter gets one, and this one again after `patience`. No waiter waits longer
/// than `give_up`, and at most `most_waiting` wait. Not safe from several threads.
class WaitingLine {
 public:
  using Clock = std::chrono::steady_clock;
  struct Rule {
    Clock::duration patience = std::chrono::seconds(10);
    Clock::duration turn = std::chrono::seconds(2);
    Clock::duration give_up = std::chrono::seconds(60);
    std::size_t most_waiting = 32;
  };
  struct Waiter {
    Clock::time_point since;
    Clock::time_point patient_since;  ///< or when its last turn ended
  };
  using Place = std::list<Waiter>::iterator;

  explicit WaitingLine(const Rule& rule) : rule_(rule) {}

  /// nullopt if too many wait already.
  std::optional<Place> Enter(Clock::time_point now);
  void Leave(Place place);

  /// Whether work that does not wait may take free memory.
  bool MayPass(Clock::time_point now);
  bool MayTake(Place place, Clock::time_point now);
  bool MustGiveUp(Place place, Clock::time_point now) const {
    return now - place->since >= rule_.give_up;
  }

  std::size_t size() const { return waiters_.size(); }

 private:
  void GiveTurn(Clock::time_point now);

  const Rule rule_;
  std::list<Waiter> waiters_;                    // most patient first
  std::optional<Clock::time_point> turn_began_;  // of the first
};

}  // namespace kdray::core
