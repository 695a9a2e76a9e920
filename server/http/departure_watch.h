// SPDX-License-Identifier: Apache-2.0
// Detects clients that leave during the work for their request, which is then cancelled.
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

/// The client of a watched connection. The watch's thread calls it under its lock: it must neither
/// block nor throw.
class WatchedClient {
 public:
  virtual ~WatchedClient() = default;

  /// Sends something to a client that has closed its sending side. A waiting client receives it;
  /// the system of one that has left answers with a reset. False if there is nothing left to send.
  virtual bool Probe() = 0;
  /// The client has left. Called at most once.
  virtual void Left() = 0;
};

/// One thread that sleeps until a watched connection is reset or half closed by its client. In TCP
/// a client that has left looks like one that only closed its sending side, so a half closed
/// connection is probed at growing intervals. A connection is added to the system's list when its
/// watch has lasted for kTick or twice that, so most requests cost no system call. Safe from many
/// threads at once.
class DepartureWatch {
 public:
  DepartureWatch();
  /// Every handle must be destroyed before.
  ~DepartureWatch();
  DepartureWatch(const DepartureWatch&) = delete;
  DepartureWatch& operator=(const DepartureWatch&) = delete;

  /// Cancels `token` and calls client.Left() when the client leaves. Ends with the handle, which
  /// must be destroyed before the socket is closed and before `client`. A socket can be watched
  /// once at a time. If the system refuses, the socket is not watched.
  std::shared_ptr<void> Watch(int fd, const core::CancelToken& token, WatchedClient& client);

  /// Cancels all current and future watches without Left(): for shutdown.
  void CancelAll();

 private:
  using Clock = std::chrono::steady_clock;
  static constexpr std::chrono::milliseconds kTick{20};
  enum class Stage : std::uint8_t { kNew, kOld, kListed };
  struct Entry {
    int fd;
    core::CancelToken token;
    WatchedClient* client;
    Stage stage = Stage::kNew;  ///< kOld: a tick has passed; kListed: the system watches it
    std::optional<Clock::time_point> next_probe = {};  ///< of a half closed connection
    /// Doubles with every probe. A client that only half closes is probed a few times, and one that
    /// leaves later is detected within the time that it has waited.
    Clock::duration interval = std::chrono::milliseconds(250);
  };
  struct Registration;
  using Entries = std::map<std::uint64_t, Entry>;

  void Run();
  void Tick();
  void Wake() const;
  void Handle(std::uint64_t id, std::uint32_t events);
  std::optional<Clock::time_point> ProbeHalfClosed();
  Entries::iterator Remove(Entries::iterator entry);
  void Forget(std::uint64_t id);

  int epoll_fd_;
  int wake_fd_;
  std::mutex mutex_;
  Entries entries_;
  std::uint64_t next_id_ = 1;
  int ticks_left_ = 0;  ///< the thread wakes every kTick until it is 0
  bool cancelling_ = false, stopping_ = false;
  std::thread thread_;
};

}  // namespace kdray::server
