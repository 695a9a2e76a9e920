// SPDX-License-Identifier: Apache-2.0
// An accepted socket, read and written under deadlines, which bound the time that a client can keep
// a thread. It handles bytes, not HTTP, and keeps bytes of the next request.
#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "server/http/chunked_framing.h"

namespace kdray::server {

/// Limits the wait for a peer: `grace`, and a second for each `bytes_per_second` bytes transferred,
/// but at most `stall` at once. So a body of n bytes takes at most grace + n / bytes_per_second of
/// waiting.
struct PaceLimit {
  std::chrono::milliseconds grace{5000};
  std::uint64_t bytes_per_second = 16 * 1024;
  std::chrono::milliseconds stall{30000};
};

/// The waits of one transfer. Counts time waiting for the peer, not our own time.
class Pace {
 public:
  using Clock = std::chrono::steady_clock;

  explicit Pace(const PaceLimit& limit) : limit_(limit) {}
  /// True if the socket is ready for `events` (poll's), false if the peer's time is used up.
  /// Meanwhile `late_since`, if not null, has the beginning of this wait in ticks of the clock, or
  /// a time before it by which the peer is behind `bytes_per_second`; otherwise 0.
  bool Wait(int fd, short events, std::atomic<Clock::rep>* late_since);
  void Moved(std::size_t bytes) { moved_ += bytes; }

 private:
  PaceLimit limit_;
  std::chrono::steady_clock::duration waited_{0};
  std::uint64_t moved_ = 0;
};

/// Used by one thread. The socket's owner closes it (connection_pool.h).
class Connection {
 public:
  using Clock = std::chrono::steady_clock;

  /// `late_since`: see Pace::Wait().
  explicit Connection(int fd, std::atomic<Clock::rep>* late_since = nullptr)
      : fd_(fd), late_since_(late_since) {}
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  int fd() const { return fd_; }

  enum class Read : std::uint8_t { kDone, kClosed, kTimeout, kTooLarge, kMalformed };
  /// Waits for the next request's first byte, at most `patience`.
  Read WaitForByte(std::chrono::milliseconds patience);
  /// Whether the whole head of the next request has been received.
  bool has_head() const;
  /// Reads the head of the next request, which head() then returns. kTooLarge beyond `max_bytes`.
  Read ReadHead(Clock::time_point deadline, std::size_t max_bytes);
  /// The part of the head that has been read.
  std::string_view head() const { return std::string_view(in_).substr(0, head_bytes_); }

  /// Declares the body after the head: its length, or nullopt for a chunked body. Call once per
  /// request.
  void BeginBody(std::optional<std::uint64_t> bytes, const PaceLimit& pace);
  /// Reads some bytes of the body; 0 bytes (with kDone) at its end. kMalformed: a chunked body's
  /// framing is invalid, see body_problem().
  Read ReadBody(std::span<std::byte> out, std::size_t* count);
  /// Drops the rest of the body. What it returns is as for ReadBody().
  Read SkipBody();
  /// Whether the whole body has been read, with the end of a chunked one.
  bool is_body_complete() const;
  /// The bytes of the body that have been read, without framing.
  std::uint64_t body_bytes() const { return body_bytes_; }
  /// For people; after kMalformed.
  std::string_view body_problem() const {
    return chunks_ ? chunks_->problem() : std::string_view();
  }
  /// Whether bytes after those of the last call have been received already.
  bool has_buffered_input() const { return in_.size() > taken_; }

  void BeginWrite(const PaceLimit& pace);
  /// False if the client has gone or its time is used up; then further writes are dropped. Small
  /// writes are combined.
  bool Write(std::string_view bytes);
  bool Flush();
  /// Bytes handed to the operating system since BeginWrite().
  std::uint64_t written() const { return written_; }

  /// Sends one byte of `start`, with which every answer begins, before the answer; Write() skips
  /// these bytes. False if all of `start` has been sent. Another thread may call it while no other
  /// method runs.
  bool SendAhead(std::string_view start);
  /// After kClosed: whether the client has left, instead of only closing its sending side. Sends
  /// ahead and waits up to `patience` for a reset from the client's system.
  bool HasLeft(std::string_view start, std::chrono::milliseconds patience);

  /// Ends the request; the next may follow. The body must have been read.
  void EndRequest();
  /// The last call. Shuts down sending, then drops what the client still sends: closing with unread
  /// bytes would make the system reset the connection and lose the answer. The rest of a body that
  /// the server did not want is dropped for as long as the client keeps sending, because many
  /// clients read nothing before they have sent everything; other bytes only for a moment. If the
  /// answer was abandoned, the connection is reset.
  void CloseGently();

 private:
  Read Fill(Clock::time_point deadline);
  Read FillBody();
  Read ReadChunked(std::span<std::byte> out, std::size_t* count);
  Read ReadData(std::byte* out, std::size_t size, std::size_t* count);
  bool Send(std::string_view bytes, bool more);

  const int fd_;
  std::atomic<Clock::rep>* const late_since_;
  std::chrono::milliseconds patience_{0};  ///< of the socket's blocking calls
  std::string in_;                         ///< the head, then further bytes
  std::size_t head_bytes_ = 0;
  std::size_t taken_ = 0;  ///< of in_, by the head and by ReadBody()
  std::uint64_t body_left_ = 0, body_bytes_ = 0;
  std::optional<ChunkedFraming> chunks_;  ///< of a chunked body
  Pace read_pace_{PaceLimit{}};
  Pace write_pace_{PaceLimit{}};
  std::string out_;
  std::uint64_t written_ = 0;
  std::size_t ahead_ = 0;  ///< bytes of the next answer that were sent ahead
  bool broken_ = false;
  bool body_failed_ = false;  ///< too slow, malformed or cut: its rest is not worth a wait
};

}  // namespace kdray::server
