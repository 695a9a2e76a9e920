// SPDX-License-Identifier: Apache-2.0
#include "core/library/waiting_line.h"

namespace kdray::core {

std::optional<WaitingLine::Place> WaitingLine::Enter(Clock::time_point now) {
  if (waiters_.size() >= rule_.most_waiting) return std::nullopt;
  return waiters_.insert(waiters_.end(), Waiter{now, now});
}

void WaitingLine::Leave(Place place) {
  if (place == waiters_.begin()) turn_began_.reset();
  waiters_.erase(place);
}

bool WaitingLine::MayPass(Clock::time_point now) {
  GiveTurn(now);
  return !turn_began_;
}

bool WaitingLine::MayTake(Place place, Clock::time_point now) {
  GiveTurn(now);
  return !turn_began_ || place == waiters_.begin();
}

// The first waiter has the turn, if any has. After its turn it moves to the end, so the list stays
// ordered by patience.
void WaitingLine::GiveTurn(Clock::time_point now) {
  if (turn_began_ && now - *turn_began_ >= rule_.turn) {
    turn_began_.reset();
    waiters_.front().patient_since = now;
    waiters_.splice(waiters_.end(), waiters_, waiters_.begin());
  }
  if (!turn_began_ && !waiters_.empty() && now - waiters_.front().patient_since >= rule_.patience) {
    turn_began_ = now;
  }
}

}  // namespace kdray::core
