// SPDX-License-Identifier: Apache-2.0
// A thread for each connection, up to a limit. Beyond it, the connections that wait longest for
// their clients make room.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <list>
#include <mutex>
#include <thread>

#include "server/http/message.h"

namespace kdray::server {

/// The threads mostly wait for clients; admission.h limits the work of requests. A failed
/// allocation or a refused thread costs at most the connection that needed it. Safe from many
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
    /// A request has begun to arrive, but its head is incomplete: may be closed as before. False if
    /// the connection is being closed.
    bool BecomeReading();
    /// A request is here. False if the connection is being closed.
    bool BecomeBusy();
    /// Its last answer is sent: the first to be closed for another one.
    void BecomeLingering();
    /// Accepted beyond the limit: must get an error, not service.
    bool shed() const { return shed_; }
    /// The connection must end after the current answer.
    bool must_close() const { return pool_->is_ending_; }
    /// Accepted after Drain().
    bool is_late() const { return is_late_; }
    /// Where its Connection tells since when its client is late (connection.h).
    std::atomic<Clock::rep>& late_since() { return late_since_; }

   private:
    friend class ConnectionPool;
    enum class State : std::uint8_t { kIdle, kReading, kBusy, kLingering, kEvicted };
    ConnectionPool* pool_ = nullptr;
    int fd_ = -1;
    int next_fd_ = -1;  ///< the connection that takes the place of this one, which was evicted
    bool shed_ = false, is_late_ = false;
    State state_ = State::kBusy;
    Clock::time_point since_;  ///< of the state
    std::atomic<Clock::rep> late_since_{0};
    std::list<Slot>::iterator self_;
    std::thread thread_;
  };
  /// Serves the connection; afterwards the pool closes it. Must not throw.
  using Serve = std::function<void(int fd, Slot& slot)>;
  /// A connection is ended for want of room. Must not throw.
  using Dropped = std::function<void(DropReason reason)>;

  ConnectionPool(std::size_t max_connections, Serve serve, Dropped dropped);
  ~ConnectionPool();

  /// Takes over the socket. At the limit, or without a thread for it, one connection is closed:
  /// first one that has its last answer; then the one that has waited longest for a complete head,
  /// idle or not; then the one whose client is latest with a body or with reading its answer. If
  /// there is none, the new one is shed; if too many are being shed, it is closed at once.
  void Accept(int fd) noexcept;
  /// Closes one connection by the same order, to free a descriptor. False if there is none.
  bool MakeRoom() noexcept;
  /// Answers the connection with an error, as beyond the limit.
  void Shed(int fd) noexcept;
  /// From now on answers are the last of their connections. Call EndIdle() now and then.
  void Drain();
  /// After Drain(): closes connections that have been idle for `grace` since then. In that time a
  /// request that is on its way gets its answer, which tells the client that it is the last one.
  void EndIdle(std::chrono::milliseconds grace);
  /// True if no connection is left; false at the deadline.
  bool WaitUntilEmpty(Clock::time_point deadline);
  /// Closes every connection and waits for its thread.
  void Stop();
  std::size_t size() const;

 private:
  bool Start(int fd, bool shed);
  void Begin(Slot& slot, int fd);
  void Run(Slot& slot) noexcept;
  void Move(Slot& slot, Slot::State state);
  std::list<Slot>& ListOf(const Slot& slot);
  Slot* FirstToGo();
  void Evict(Slot& slot, int next_fd);
  void Drop(int fd, DropReason reason);
  void JoinFinished();

  const std::size_t max_connections_;
  const Serve serve_;
  const Dropped dropped_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  // Slots move between these lists, which allocates nothing.
  std::list<Slot> waiting_;   ///< idle, reading or lingering; the first to go comes first
  std::list<Slot> working_;   ///< busy or evicted
  std::list<Slot> finished_;  ///< whose threads end
  std::size_t serving_ = 0, shedding_ = 0;
  Clock::time_point drained_;
  std::atomic<bool> is_ending_{false};  ///< after Drain() or Stop()
  bool stopping_ = false;
};

}  // namespace kdray::server
