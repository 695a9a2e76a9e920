// A thread for each connection, up to a limit.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <list>
#include <mutex>
#include <thread>
#include <vector>

namespace kdray::server {

/// The threads mostly wait for clients; admission.h limits the work of requests. Safe from many
/// threads at once.
class ConnectionPool {
 public:
  using Clock = std::chrono::steady_clock;

  /// One connection in the pool; used by its thread.
  class Slot {
   public:
    /// Between two requests: from now on the connection may be closed to accept another one. False
    /// if it must end now.
    bool BecomeIdle();
    /// A request has begun to arrive. False if the connection is being closed.
    bool BecomeBusy();
    /// Accepted beyond the limit: must get an error, not service.
    bool shed() const { return shed_; }
    /// The connection must end after the current answer.
    bool must_close() const;

   private:
    friend class ConnectionPool;
    enum class State : std::uint8_t { kIdle, kBusy, kEvicted };
    ConnectionPool* pool_ = nullptr;
    int fd_ = -1;
    bool shed_ = false;
    State state_ = State::kIdle;
    Clock::time_point idle_since_;
    std::thread thread_;
  };
  /// Serves the connection; afterwards the pool closes it. Must not throw.
  using Serve = std::function<void(int fd, Slot& slot)>;

  ConnectionPool(std::size_t max_connections, Serve serve);
  ~ConnectionPool();

  /// Takes over the socket. At the limit, the longest idle connection is closed; if none is idle,
  /// the new one is shed; if too many are being shed, it is closed at once.
  void Accept(int fd);
  /// Closes idle connections at once, others after their current answer.
  void Drain();
  /// True if no connection is left; false at the deadline.
  bool WaitUntilEmpty(Clock::time_point deadline);
  /// Closes every connection and waits for its thread.
  void Stop();
  std::size_t size() const;

 private:
  void Start(int fd, bool shed);
  void Run(std::list<Slot>::iterator slot);
  bool EvictLongestIdle();
  void JoinFinished();
  static bool HasInput(int fd);

  const std::size_t max_connections_;
  const Serve serve_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::list<Slot> slots_;
  std::size_t serving_ = 0, shedding_ = 0;
  std::deque<int> pending_;  ///< accepted for the place of an evicted connection
  std::vector<std::thread> finished_;
  bool draining_ = false, stopping_ = false;
};

}  // namespace kdray::server
