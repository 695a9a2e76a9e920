// One accepted socket, read and written under deadlines and budgets: nothing a client does or
// leaves undone keeps a thread longer than these allow. Knows bytes, not HTTP; keeps what was read
// too far for the next request.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

namespace kdray::server {

/// How long a peer may keep us waiting while it moves bytes: `grace`, and a second more for each
/// `bytes_per_second` that moved; but never `stall` in one piece. So a body of n bytes takes at
/// most grace + n / bytes_per_second of waiting.
struct PaceLimit {
  std::chrono::milliseconds grace{5000};
  std::uint64_t bytes_per_second = 16 * 1024;
  std::chrono::milliseconds stall{30000};
};

/// Waits on behalf of one transfer. Counts the time spent waiting for the peer, not the time that
/// we take ourselves.
class Pace {
 public:
  explicit Pace(const PaceLimit& limit) : limit_(limit) {}
  /// True when the socket became ready for `events` (poll's), false when the peer's time is up.
  bool Wait(int fd, short events);
  void Moved(std::size_t bytes) { moved_ += bytes; }

 private:
  PaceLimit limit_;
  std::chrono::steady_clock::duration waited_{0};
  std::uint64_t moved_ = 0;
};

/// Used by one thread. The socket stays its owner's to close (connection_pool.h).
class Connection {
 public:
  using Clock = std::chrono::steady_clock;

  explicit Connection(int fd) : fd_(fd) {}
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  int fd() const { return fd_; }

  enum class Read : std::uint8_t { kDone, kClosed, kTimeout, kTooLarge };
  /// Until the next request's first byte is here.
  Read WaitForByte(Clock::time_point deadline);
  /// Until the head of the next request is here; then head() is it. kTooLarge beyond `max_bytes`.
  Read ReadHead(Clock::time_point deadline, std::size_t max_bytes);
  /// What has been read of the head so far.
  std::string_view head() const { return std::string_view(in_).substr(0, head_bytes_); }

  /// Declares what follows the head. To be called once a request.
  void BeginBody(std::uint64_t bytes, const PaceLimit& pace);
  /// Some bytes of the body, 0 bytes (with kDone) at its end.
  Read ReadBody(std::span<std::byte> out, std::size_t* count);
  std::uint64_t body_left() const { return body_left_; }
  /// Bytes that came before they were asked for.
  bool has_buffered_input() const { return in_.size() > head_bytes_; }

  void BeginWrite(const PaceLimit& pace);
  /// False once the client has gone or its time is up; then everything further is dropped. Small
  /// writes are gathered.
  bool Write(std::string_view bytes);
  bool Flush();
  /// Bytes handed to the operating system since BeginWrite().
  std::uint64_t written() const { return written_; }

  /// Sends one byte of `start`, which every answer begins with, before there is an answer; Write()
  /// leaves out what was sent so. False when all of `start` has been sent. Another thread may call
  /// it, while no other method runs.
  bool SendAhead(std::string_view start);
  /// After kClosed: whether the client has left, and has not only closed its sending side. Sends
  /// ahead and waits up to `patience` for the client's system to refuse it.
  bool HasLeft(std::string_view start, std::chrono::milliseconds patience);

  /// Forgets the head; the next request may follow. The body must have been read.
  void EndRequest();
  /// The last call. Says that nothing more will be sent, then reads a little and for a short while
  /// what the client still sends: closing on unread bytes would make the system reset the
  /// connection, and an answer under way would be lost. An answer that was given up is not sent on:
  /// then the connection will be reset.
  void CloseGently();

 private:
  Read Fill(Clock::time_point deadline);
  bool Send(std::string_view bytes, bool more);

  int fd_;
  std::string in_;  ///< head, then bytes read beyond it
  std::size_t head_bytes_ = 0;
  std::uint64_t body_left_ = 0;
  Pace read_pace_{PaceLimit{}};
  Pace write_pace_{PaceLimit{}};
  std::string out_;
  std::uint64_t written_ = 0;
  std::size_t ahead_ = 0;  ///< bytes of the next answer that were sent before it
  bool broken_ = false;
};

}  // namespace kdray::server
