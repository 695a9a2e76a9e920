// SPDX-License-Identifier: Apache-2.0
#include "server/http/connection_pool.h"

#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <utility>

namespace kdray::server {
namespace {

using std::chrono::milliseconds;

/// Connections refused at the same time; each holds a thread for a fraction of a second.
constexpr std::size_t kMaxShedding = 32;
/// A head that has not come within this time is slow; those of ordinary clients take a round trip.
constexpr milliseconds kSlowHead{2};
/// A client that is this late with a body, or with reading, may be cut off to make room.
constexpr milliseconds kLate{500};
/// Time for clients that still send a refused body while the server drains.
constexpr milliseconds kDrainLinger{1000};
/// Idle connections that FirstToGo() asks for input.
constexpr int kMaxLooks = 64;

/// shutdown() ends the connection at once. close() alone would leave it open while another thread
/// is in a call that waits for the same file.
void Close(int fd) {
  shutdown(fd, SHUT_RDWR);
  close(fd);
}

bool HasInput(int fd) {
  pollfd entry{.fd = fd, .events = POLLIN, .revents = 0};
  return poll(&entry, 1, 0) > 0;
}

}  // namespace

bool ConnectionPool::Slot::BecomeIdle() {
  const std::lock_guard lock(pool_->mutex_);
  if (state_ == State::kEvicted || pool_->stopping_) return false;
  pool_->Move(*this, State::kIdle);
  return true;
}

bool ConnectionPool::Slot::BecomeReading() {
  const std::lock_guard lock(pool_->mutex_);
  if (state_ == State::kEvicted) return false;
  pool_->Move(*this, State::kReading);
  return true;
}

bool ConnectionPool::Slot::BecomeBusy() {
  const std::lock_guard lock(pool_->mutex_);
  if (state_ == State::kEvicted) return false;
  pool_->Move(*this, State::kBusy);
  return true;
}

void ConnectionPool::Slot::BecomeLingering() {
  const std::lock_guard lock(pool_->mutex_);
  if (state_ != State::kEvicted && !shed_) pool_->Move(*this, State::kLingering);
}

ConnectionPool::ConnectionPool(std::size_t max_connections, Serve serve, Dropped dropped)
    : max_connections_(max_connections), serve_(std::move(serve)), dropped_(std::move(dropped)) {}

ConnectionPool::~ConnectionPool() { Stop(); }

void ConnectionPool::Accept(int fd) noexcept {
  JoinFinished();
  const std::lock_guard lock(mutex_);
  if (stopping_) {
    Close(fd);
    return;
  }
  if (serving_ < max_connections_ && Start(fd, false)) return;
  if (Slot* const slot = FirstToGo()) {
    Evict(*slot, fd);
  } else if (shedding_ < kMaxShedding && Start(fd, true)) {
    dropped_(DropReason::kRefused);
  } else {
    Drop(fd, DropReason::kClosed);
  }
}

bool ConnectionPool::MakeRoom() noexcept {
  JoinFinished();
  const std::lock_guard lock(mutex_);
  Slot* const slot = FirstToGo();
  if (slot != nullptr) Evict(*slot, -1);
  return slot != nullptr;
}

void ConnectionPool::Shed(int fd) noexcept {
  const std::lock_guard lock(mutex_);
  if (!stopping_ && shedding_ < kMaxShedding && Start(fd, true)) {
    dropped_(DropReason::kRefused);
  } else {
    Drop(fd, DropReason::kClosed);
  }
}

void ConnectionPool::Drop(int fd, DropReason reason) {
  Close(fd);
  dropped_(reason);
}

/// False if there is no memory or no thread for it.
bool ConnectionPool::Start(int fd, bool shed) {
  std::list<Slot> made;  // of one slot; gone with it if no thread can be made
  try {
    Slot& slot = made.emplace_back();
    slot.pool_ = this;
    slot.self_ = made.begin();
    slot.shed_ = shed;
    slot.thread_ = std::thread([this, &slot] { Run(slot); });  // waits for our lock
  } catch (...) {
    return false;
  }
  Slot& slot = made.front();
  working_.splice(working_.end(), made);
  Begin(slot, fd);
  ++(shed ? shedding_ : serving_);
  return true;
}

/// With a new connection.
void ConnectionPool::Begin(Slot& slot, int fd) {
  slot.fd_ = fd;
  slot.is_late_ = is_ending_;
  slot.late_since_ = 0;
  if (!slot.shed_) Move(slot, Slot::State::kIdle);
}

void ConnectionPool::Run(Slot& slot) noexcept {
  std::unique_lock lock(mutex_);
  for (;;) {
    const int fd = slot.fd_;
    lock.unlock();
    serve_(fd, slot);
    lock.lock();
    Close(fd);  // under the lock, so no other thread shuts down a reused descriptor
    const int next = std::exchange(slot.next_fd_, -1);
    if (next >= 0 && !stopping_) {
      slot.state_ = Slot::State::kBusy;
      Begin(slot, next);
      continue;
    }
    if (next >= 0) Close(next);
    --(slot.shed_ ? shedding_ : serving_);
    slot.fd_ = -1;
    finished_.splice(finished_.end(), ListOf(slot), slot.self_);
    changed_.notify_all();
    return;
  }
}

std::list<ConnectionPool::Slot>& ConnectionPool::ListOf(const Slot& slot) {
  return slot.state_ == Slot::State::kBusy || slot.state_ == Slot::State::kEvicted ? working_
                                                                                   : waiting_;
}

void ConnectionPool::Move(Slot& slot, Slot::State state) {
  std::list<Slot>& from = ListOf(slot);
  slot.state_ = state;
  slot.since_ = Clock::now();
  std::list<Slot>& to = ListOf(slot);
  to.splice(state == Slot::State::kLingering ? to.begin() : to.end(), from, slot.self_);
}

ConnectionPool::Slot* ConnectionPool::FirstToGo() {
  const auto now = Clock::now();
  int looks = 0;
  for (Slot& slot : waiting_) {
    if (slot.state_ == Slot::State::kLingering) return &slot;
    if (slot.state_ == Slot::State::kReading) {
      if (now - slot.since_ >= kSlowHead) return &slot;
    } else if (!HasInput(slot.fd_)) {  // else its next request is here
      return &slot;
    }
    if (++looks == kMaxLooks) break;
  }
  Slot* latest = nullptr;
  Clock::rep since = (now - kLate).time_since_epoch().count();
  for (Slot& slot : working_) {
    const Clock::rep late_since = slot.late_since_;
    if (slot.state_ != Slot::State::kBusy || late_since == 0 || late_since > since) continue;
    since = late_since;
    latest = &slot;
  }
  return latest;
}

void ConnectionPool::Evict(Slot& slot, int next_fd) {
  Move(slot, Slot::State::kEvicted);
  slot.next_fd_ = next_fd;
  shutdown(slot.fd_, SHUT_RDWR);
  dropped_(DropReason::kEvicted);
}

void ConnectionPool::Drain() {
  const std::lock_guard lock(mutex_);
  drained_ = Clock::now();
  is_ending_ = true;
}

void ConnectionPool::EndIdle(milliseconds grace) {
  const std::lock_guard lock(mutex_);
  const auto now = Clock::now();
  for (auto next = waiting_.begin(); next != waiting_.end();) {
    Slot& slot = *next++;
    const auto waited = now - std::max(slot.since_, drained_);
    const bool ends = slot.state_ == Slot::State::kIdle        ? waited >= grace
                      : slot.state_ == Slot::State::kLingering ? waited >= kDrainLinger
                                                               : false;
    if (!ends || (slot.state_ == Slot::State::kIdle && HasInput(slot.fd_))) continue;
    Move(slot, Slot::State::kEvicted);
    shutdown(slot.fd_, SHUT_RDWR);
  }
}

bool ConnectionPool::WaitUntilEmpty(Clock::time_point deadline) {
  std::unique_lock lock(mutex_);
  return changed_.wait_until(lock, deadline,
                             [this] { return waiting_.empty() && working_.empty(); });
}

void ConnectionPool::Stop() {
  {
    std::unique_lock lock(mutex_);
    stopping_ = true;
    is_ending_ = true;
    for (std::list<Slot>* slots : {&waiting_, &working_}) {
      for (Slot& slot : *slots) shutdown(slot.fd_, SHUT_RDWR);
    }
    changed_.wait(lock, [this] { return waiting_.empty() && working_.empty(); });
  }
  JoinFinished();
}

void ConnectionPool::JoinFinished() {
  std::list<Slot> finished;
  {
    const std::lock_guard lock(mutex_);
    finished.swap(finished_);
  }
  for (Slot& slot : finished) slot.thread_.join();
}

std::size_t ConnectionPool::size() const {
  const std::lock_guard lock(mutex_);
  return waiting_.size() + working_.size();
}

}  // namespace kdray::server
