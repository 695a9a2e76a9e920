#include "server/http/departure_watch.h"

#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <cerrno>
#include <system_error>
#include <vector>

namespace kdray::server {

DepartureWatch::DepartureWatch() : wake_fd_(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {
  if (wake_fd_ < 0) throw std::system_error(errno, std::generic_category(), "eventfd");
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
}

std::shared_ptr<void> DepartureWatch::Watch(int fd, const core::CancelToken& token) {
  std::uint64_t id = 0;
  {
    const std::lock_guard lock(mutex_);
    id = next_id_++;
    entries_.emplace(id, Entry{fd, token});
  }
  Wake();
  return {nullptr, [this, id](void*) { Forget(id); }};
}

void DepartureWatch::Forget(std::uint64_t id) {
  // The thread need not wake: an event for an entry that is gone is dropped in Run().
  const std::lock_guard lock(mutex_);
  entries_.erase(id);
}

void DepartureWatch::Wake() const {
  // Fails only when the counter is full, and then the thread is awake already.
  [[maybe_unused]] const int failed = eventfd_write(wake_fd_, 1);
}

void DepartureWatch::Run() {
  std::vector<pollfd> polled;
  std::vector<std::uint64_t> ids;
  for (;;) {
    polled.assign(1, pollfd{.fd = wake_fd_, .events = POLLIN, .revents = 0});
    ids.assign(1, 0);
    {
      const std::lock_guard lock(mutex_);
      if (stopping_) return;
      for (const auto& [id, entry] : entries_) {
        polled.push_back(pollfd{.fd = entry.fd, .events = POLLRDHUP, .revents = 0});
        ids.push_back(id);
      }
    }
    if (poll(polled.data(), polled.size(), -1) <= 0) continue;
    if (polled[0].revents != 0) {
      eventfd_t count = 0;
      eventfd_read(wake_fd_, &count);
    }
    const std::lock_guard lock(mutex_);
    for (std::size_t i = 1; i < polled.size(); ++i) {
      if (polled[i].revents == 0) continue;
      // An entry that has gone meanwhile took its answer with it.
      const auto entry = entries_.find(ids[i]);
      if (entry == entries_.end()) continue;
      entry->second.token.Cancel();
      entries_.erase(entry);
    }
  }
}

}  // namespace kdray::server
