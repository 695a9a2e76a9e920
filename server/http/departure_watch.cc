// SPDX-License-Identifier: Apache-2.0
#include "server/http/departure_watch.h"

#include <sys/epoll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <climits>
#include <system_error>
#include <utility>

namespace kdray::server {
namespace {

constexpr std::uint64_t kWakeId = 0;
/// The thread goes on waking for this long after the last watch: waking it costs a system call.
constexpr int kIdleTicks = 50;

int Control(int epoll_fd, int operation, int fd, std::uint64_t id, std::uint32_t events) {
  epoll_event event{};
  event.events = events;
  event.data.u64 = id;
  return epoll_ctl(epoll_fd, operation, fd, &event);
}

}  // namespace

// epoll instead of poll(): a thread inside poll() holds the files that it waits for, so close()
// would not end their connections. epoll holds none.
DepartureWatch::DepartureWatch()
    : epoll_fd_(epoll_create1(EPOLL_CLOEXEC)), wake_fd_(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {
  if (epoll_fd_ < 0 || wake_fd_ < 0 ||
      Control(epoll_fd_, EPOLL_CTL_ADD, wake_fd_, kWakeId, EPOLLIN) != 0) {
    throw std::system_error(errno, std::generic_category(), "epoll");
  }
  thread_ = std::thread([this] { Run(); });
}

DepartureWatch::~DepartureWatch() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  Wake();
  thread_.join();
  close(wake_fd_);
  close(epoll_fd_);
}

// Made before the lock is taken, because its destructor takes it.
struct DepartureWatch::Registration {
  ~Registration() {
    if (id != kWakeId) watch->Forget(id);
  }
  DepartureWatch* watch;
  std::uint64_t id = kWakeId;
};

std::shared_ptr<void> DepartureWatch::Watch(int fd, const core::CancelToken& token,
                                            WatchedClient& client) {
  auto registration = std::make_shared<Registration>(Registration{this});
  const std::lock_guard lock(mutex_);
  if (cancelling_) {
    token.Cancel();
    return nullptr;
  }
  const std::uint64_t id = next_id_++;
  entries_.emplace(id, Entry{.fd = fd, .token = token, .client = &client});
  registration->id = id;
  if (std::exchange(ticks_left_, kIdleTicks) == 0) Wake();
  return registration;
}

void DepartureWatch::Wake() const {
  // Fails only if the counter is full, and then the thread is awake already.
  [[maybe_unused]] const int failed = eventfd_write(wake_fd_, 1);
}

void DepartureWatch::CancelAll() {
  const std::lock_guard lock(mutex_);
  cancelling_ = true;
  for (auto entry = entries_.begin(); entry != entries_.end();) {
    entry->second.token.Cancel();
    entry = Remove(entry);
  }
}

void DepartureWatch::Forget(std::uint64_t id) {
  const std::lock_guard lock(mutex_);
  if (const auto entry = entries_.find(id); entry != entries_.end()) Remove(entry);
}

DepartureWatch::Entries::iterator DepartureWatch::Remove(Entries::iterator entry) {
  if (entry->second.stage == Stage::kListed) {
    Control(epoll_fd_, EPOLL_CTL_DEL, entry->second.fd, entry->first, 0);
  }
  return entries_.erase(entry);
}

void DepartureWatch::Run() {
  std::array<epoll_event, 64> events;
  std::optional<Clock::time_point> next_probe;
  bool ticks = false;
  auto next_tick = Clock::now();
  for (;;) {
    int timeout_ms = ticks ? static_cast<int>(kTick.count()) : -1;
    if (!ticks && next_probe) {
      const auto left =
          std::chrono::ceil<std::chrono::milliseconds>(*next_probe - Clock::now()).count();
      timeout_ms = static_cast<int>(std::clamp<long long>(left, 0, INT_MAX));
    }
    const int count =
        epoll_wait(epoll_fd_, events.data(), static_cast<int>(events.size()), timeout_ms);
    const std::lock_guard lock(mutex_);
    if (stopping_) return;
    for (int i = 0; i < count; ++i) {
      const epoll_event& event = events[static_cast<std::size_t>(i)];
      if (event.data.u64 == kWakeId) {
        eventfd_t wakes = 0;
        [[maybe_unused]] const int failed = eventfd_read(wake_fd_, &wakes);
      } else {
        Handle(event.data.u64, event.events);
      }
    }
    if (const auto now = Clock::now(); now >= next_tick) {
      Tick();
      next_tick = now + kTick;
    }
    next_probe = ProbeHalfClosed();
    ticks = ticks_left_ > 0;
  }
}

// Hands to the system what has been watched for a whole tick.
void DepartureWatch::Tick() {
  if (ticks_left_ > 0) --ticks_left_;
  for (auto entry = entries_.begin(); entry != entries_.end();) {
    const auto current = entry++;
    Entry& watched = current->second;
    if (watched.stage == Stage::kListed) continue;
    ticks_left_ = kIdleTicks;
    if (watched.stage == Stage::kNew) {
      watched.stage = Stage::kOld;
    } else if (Control(epoll_fd_, EPOLL_CTL_ADD, watched.fd, current->first, EPOLLRDHUP) == 0) {
      watched.stage = Stage::kListed;
    } else {
      entries_.erase(current);
    }
  }
}

void DepartureWatch::Handle(std::uint64_t id, std::uint32_t events) {
  const auto entry = entries_.find(id);
  if (entry == entries_.end()) return;  // answered meanwhile
  if ((events & (EPOLLERR | EPOLLHUP)) != 0) {
    entry->second.token.Cancel();
    entry->second.client->Left();
    Remove(entry);
    return;
  }
  // Half closed, which is reported once; a reset is always reported.
  Control(epoll_fd_, EPOLL_CTL_MOD, entry->second.fd, id, 0);
  entry->second.next_probe = Clock::now();
}

std::optional<DepartureWatch::Clock::time_point> DepartureWatch::ProbeHalfClosed() {
  std::optional<Clock::time_point> next;
  const auto now = Clock::now();
  for (auto& [id, entry] : entries_) {
    if (!entry.next_probe) continue;
    if (*entry.next_probe <= now) {
      entry.next_probe = now + entry.interval;
      entry.interval *= 2;
      if (!entry.client->Probe()) entry.next_probe.reset();
    }
    if (entry.next_probe && (!next || *entry.next_probe < *next)) next = entry.next_probe;
  }
  return next;
}

}  // namespace kdray::server
