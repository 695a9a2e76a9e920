#include "server/http/departure_watch.h"

#include <sys/epoll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <climits>
#include <system_error>

namespace kdray::server {
namespace {

constexpr std::uint64_t kWakeId = 0;
/// Doubles with every probe. A client that only half closes is probed a few times, and one that
/// leaves later is detected within the time that it has waited.
constexpr std::chrono::milliseconds kFirstInterval{250};

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
  // Fails only if the counter is full, and then the thread is awake already.
  [[maybe_unused]] const int failed = eventfd_write(wake_fd_, 1);
  thread_.join();
  close(wake_fd_);
  close(epoll_fd_);
}

std::shared_ptr<void> DepartureWatch::Watch(int fd, const core::CancelToken& token,
                                            WatchedClient& client) {
  const std::lock_guard lock(mutex_);
  if (cancelling_) {
    token.Cancel();
    return nullptr;
  }
  const std::uint64_t id = next_id_++;
  const auto entry =
      entries_.emplace(id, Entry{fd, token, &client, std::nullopt, kFirstInterval}).first;
  if (Control(epoll_fd_, EPOLL_CTL_ADD, fd, id, EPOLLRDHUP) != 0) {
    entries_.erase(entry);
    return nullptr;
  }
  try {
    return {nullptr, [this, id](void*) { Forget(id); }};
  } catch (...) {
    Remove(entry);
    throw;
  }
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
  Control(epoll_fd_, EPOLL_CTL_DEL, entry->second.fd, entry->first, 0);
  return entries_.erase(entry);
}

void DepartureWatch::Run() {
  std::array<epoll_event, 64> events;
  std::optional<Clock::time_point> next_probe;
  for (;;) {
    int timeout_ms = -1;
    if (next_probe) {
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
      if (event.data.u64 != kWakeId) Handle(event.data.u64, event.events);
    }
    next_probe = ProbeHalfClosed();
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
