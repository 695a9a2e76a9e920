// Notices clients that leave while their request is worked on, so that nobody computes for no one.
#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>

#include "core/base/cancel.h"

namespace kdray::server {

/// The client of a watched connection. Called by the watch's thread under its lock: must neither
/// block nor throw.
class WatchedClient {
 public:
  virtual ~WatchedClient() = default;

  /// Sends something to a client that has closed its sending side. A client that still waits takes
  /// it; the system of one that has left answers with a reset. False when there is nothing to send
  /// any more.
  virtual bool Probe() = 0;
  /// The client has left. Called at most once.
  virtual void Left() = 0;
};

/// One thread that sleeps until a watched connection is reset, or half closed by its client. TCP
/// shows a client that has left and one that only sends nothing more in the same way, so a half
/// closed connection is probed, at growing intervals. Safe from many threads at once.
class DepartureWatch {
 public:
  DepartureWatch();
  /// Every handle must be gone by then.
  ~DepartureWatch();
  DepartureWatch(const DepartureWatch&) = delete;
  DepartureWatch& operator=(const DepartureWatch&) = delete;

  /// Cancels `token` and tells `client` when the client leaves. Ends with the handle, which must go
  /// before the socket is closed and before `client`. A socket is watched once at a time. When the
  /// system refuses, the socket is not watched.
  std::shared_ptr<void> Watch(int fd, const core::CancelToken& token, WatchedClient& client);

  /// Cancels whatever is watched and will be watched, without telling that its client has left: for
  /// the server's own end.
  void CancelAll();

 private:
  using Clock = std::chrono::steady_clock;
  struct Entry {
    int fd;
    core::CancelToken token;
    WatchedClient* client;
    std::optional<Clock::time_point> next_probe;  ///< of a connection that is half closed
    Clock::duration interval;
  };
  using Entries = std::map<std::uint64_t, Entry>;

  void Run();
  void Handle(std::uint64_t id, std::uint32_t events);
  std::optional<Clock::time_point> ProbeHalfClosed();
  Entries::iterator Remove(Entries::iterator entry);
  void Forget(std::uint64_t id);

  int epoll_fd_;
  int wake_fd_;
  std::mutex mutex_;
  Entries entries_;
  std::uint64_t next_id_ = 1;
  bool cancelling_ = false, stopping_ = false;
  std::thread thread_;
};

}  // namespace kdray::server
