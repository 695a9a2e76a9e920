#include "server/http/connection_pool.h"

#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <system_error>
#include <utility>

namespace kdray::server {
namespace {

/// Connections refused at the same time; each holds a thread for a fraction of a second.
constexpr std::size_t kMaxShedding = 32;

/// shutdown() ends the connection at once. close() alone would leave it open while another thread
/// is in a call that waits for the same file.
void Close(int fd) {
  shutdown(fd, SHUT_RDWR);
  close(fd);
}

}  // namespace

bool ConnectionPool::Slot::BecomeIdle() {
  const std::lock_guard lock(pool_->mutex_);
  state_ = State::kIdle;
  idle_since_ = Clock::now();
  return !pool_->draining_ && !pool_->stopping_;
}

bool ConnectionPool::Slot::BecomeBusy() {
  const std::lock_guard lock(pool_->mutex_);
  if (state_ == State::kEvicted) return false;
  state_ = State::kBusy;
  return true;
}

bool ConnectionPool::Slot::must_close() const {
  const std::lock_guard lock(pool_->mutex_);
  return pool_->draining_ || pool_->stopping_;
}

ConnectionPool::ConnectionPool(std::size_t max_connections, Serve serve)
    : max_connections_(max_connections), serve_(std::move(serve)) {}

ConnectionPool::~ConnectionPool() { Stop(); }

void ConnectionPool::Accept(int fd) {
  JoinFinished();
  const std::lock_guard lock(mutex_);
  if (stopping_) {
    Close(fd);
  } else if (serving_ < max_connections_) {
    Start(fd, false);
  } else if (EvictLongestIdle()) {
    pending_.push_back(fd);
  } else if (shedding_ < kMaxShedding) {
    Start(fd, true);
  } else {
    Close(fd);
  }
}

void ConnectionPool::Start(int fd, bool shed) {
  slots_.emplace_front();
  const auto slot = slots_.begin();
  slot->pool_ = this;
  slot->fd_ = fd;
  slot->shed_ = shed;
  slot->state_ = shed ? Slot::State::kBusy : Slot::State::kIdle;
  slot->idle_since_ = Clock::now();
  try {
    slot->thread_ = std::thread([this, slot] { Run(slot); });
  } catch (const std::system_error&) {  // no thread available: the client may try again
    Close(fd);
    slots_.erase(slot);
    return;
  }
  ++(shed ? shedding_ : serving_);
}

void ConnectionPool::Run(std::list<Slot>::iterator slot) {
  for (;;) {
    serve_(slot->fd_, *slot);
    const std::lock_guard lock(mutex_);
    Close(slot->fd_);  // under the lock, so no other thread shuts down a reused descriptor
    if (!slot->shed_ && !pending_.empty() && !stopping_) {
      slot->fd_ = pending_.front();
      pending_.pop_front();
      slot->state_ = Slot::State::kIdle;
      slot->idle_since_ = Clock::now();
      continue;
    }
    --(slot->shed_ ? shedding_ : serving_);
    finished_.push_back(std::move(slot->thread_));
    slots_.erase(slot);
    changed_.notify_all();
    return;
  }
}

bool ConnectionPool::HasInput(int fd) {
  pollfd entry{.fd = fd, .events = POLLIN, .revents = 0};
  return poll(&entry, 1, 0) > 0;
}

bool ConnectionPool::EvictLongestIdle() {
  Slot* oldest = nullptr;
  for (Slot& slot : slots_) {
    if (slot.state_ != Slot::State::kIdle) continue;
    if (oldest != nullptr && slot.idle_since_ >= oldest->idle_since_) continue;
    if (!HasInput(slot.fd_)) oldest = &slot;  // else its next request is here
  }
  if (oldest == nullptr) return false;
  oldest->state_ = Slot::State::kEvicted;
  shutdown(oldest->fd_, SHUT_RDWR);
  return true;
}

void ConnectionPool::Drain() {
  const std::lock_guard lock(mutex_);
  draining_ = true;
  for (Slot& slot : slots_) {
    if (slot.state_ == Slot::State::kIdle && !HasInput(slot.fd_)) {
      slot.state_ = Slot::State::kEvicted;
      shutdown(slot.fd_, SHUT_RDWR);
    }
  }
}

bool ConnectionPool::WaitUntilEmpty(Clock::time_point deadline) {
  std::unique_lock lock(mutex_);
  return changed_.wait_until(lock, deadline, [this] { return slots_.empty(); });
}

void ConnectionPool::Stop() {
  {
    std::unique_lock lock(mutex_);
    stopping_ = true;
    for (const int fd : pending_) Close(fd);
    pending_.clear();
    for (Slot& slot : slots_) shutdown(slot.fd_, SHUT_RDWR);
    changed_.wait(lock, [this] { return slots_.empty(); });
  }
  JoinFinished();
}

void ConnectionPool::JoinFinished() {
  std::vector<std::thread> finished;
  {
    const std::lock_guard lock(mutex_);
    finished.swap(finished_);
  }
  for (std::thread& thread : finished) thread.join();
}

std::size_t ConnectionPool::size() const {
  const std::lock_guard lock(mutex_);
  return slots_.size();
}

}  // namespace kdray::server
