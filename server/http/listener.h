// SPDX-License-Identifier: Apache-2.0
// The listening socket: accepts connections until it is told to stop, whatever the system reports.
#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <thread>

namespace kdray::server {

/// Accepts in a thread of its own. Stop() and Wake() may be called from any thread.
class Listener {
 public:
  struct Events {
    /// Takes over an accepted socket. Must not throw, as the others.
    std::function<void(int fd)> accepted;
    /// The system has no descriptor or memory for a connection. True if one will be free soon.
    std::function<bool()> exhausted;
    /// Takes over a socket that was accepted though `exhausted` found nothing to free: for an
    /// answer that refuses it.
    std::function<void(int fd)> refused;
    /// Called every kTick after Wake(), until Stop().
    std::function<void()> tick;
  };
  static constexpr std::chrono::milliseconds kTick{20};

  /// Takes over `fd`, a bound socket, and listens on it. Throws std::system_error if that fails.
  Listener(int fd, int backlog, Events events);
  ~Listener();
  Listener(const Listener&) = delete;
  Listener& operator=(const Listener&) = delete;

  /// Throws std::system_error if no thread can be made.
  void Start();
  /// From now on `tick` is called.
  void Wake();
  /// Lets no new connection begin, and waits until those that have are accepted. Their clients'
  /// systems try again, and are refused once the socket is closed.
  void CloseQueue();
  /// Ends the thread and closes the socket.
  void Stop();

 private:
  enum class Accepted : unsigned char { kOne, kNone, kFailed };

  void Run() noexcept;
  Accepted AcceptOne() noexcept;
  void MakeRoom() noexcept;
  void Sleep(std::chrono::milliseconds time) const noexcept;

  const Events events_;
  int fd_, wake_fd_;
  int spare_fd_;  ///< given up to accept a connection when no descriptor is free
  std::atomic<bool> ticks_{false}, stopping_{false};
  std::thread thread_;
};

}  // namespace kdray::server
