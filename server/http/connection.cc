// SPDX-License-Identifier: Apache-2.0
#include "server/http/connection.h"

#include <poll.h>
#include <sys/socket.h>
#include <sys/time.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <climits>
#include <limits>
#include <utility>

#include "server/http/request_head.h"

namespace kdray::server {
namespace {

using Clock = Connection::Clock;
using std::chrono::milliseconds;

constexpr std::size_t kReadBytes = 8 * 1024;
/// Chunks are often small, so a chunked body is read in pieces of this size.
constexpr std::size_t kChunkedReadBytes = 64 * 1024;
constexpr std::size_t kGatherBytes = 16 * 1024;
constexpr std::uint64_t kMostDroppedBytes = std::uint64_t{1} << 30;  ///< by one system call

/// How long the client's further bytes are dropped before its connection is closed.
struct Linger {
  milliseconds silence;  ///< the longest pause
  milliseconds total;
  std::uint64_t bytes;
};
constexpr Linger kShortLinger{milliseconds(200), milliseconds(200), 64 * 1024};
constexpr Linger kBodyLinger{milliseconds(2000), milliseconds(30000),
                             std::numeric_limits<std::uint64_t>::max()};

/// Waits for `events` or an error condition on the socket; false at the deadline.
bool WaitUntil(int fd, short events, Clock::time_point deadline) {
  for (;;) {
    const auto left = std::chrono::ceil<milliseconds>(deadline - Clock::now()).count();
    if (left <= 0) return false;
    pollfd entry{.fd = fd, .events = events, .revents = 0};
    const int ready = poll(&entry, 1, static_cast<int>(std::min<long long>(left, INT_MAX)));
    if (ready > 0) return true;
    if (ready < 0 && errno != EINTR) return true;  // the next call on the socket reports the error
  }
}

bool WouldBlock() { return errno == EAGAIN || errno == EWOULDBLOCK; }

/// recv() that does not block and is retried after signals: bytes, 0 at the end, -1 with errno.
/// Without `out`, the system drops the bytes instead of copying them (tcp(7), MSG_TRUNC).
ssize_t Receive(int fd, void* out, std::size_t size) {
  const int flags = MSG_DONTWAIT | (out == nullptr ? MSG_TRUNC : 0);
  for (;;) {
    const ssize_t count = recv(fd, out, size, flags);
    if (count >= 0 || errno != EINTR) return count;
  }
}

}  // namespace

bool Pace::Wait(int fd, short events, std::atomic<Clock::rep>* late_since) {
  const std::chrono::duration<double> earned(static_cast<double>(moved_) /
                                             static_cast<double>(limit_.bytes_per_second));
  const auto credit = std::chrono::duration_cast<Clock::duration>(earned);
  const auto left = Clock::duration(limit_.grace) + credit - waited_;
  const auto start = Clock::now();
  if (late_since != nullptr) {
    const auto behind = std::max(waited_ - credit, Clock::duration(0));
    *late_since = (start - behind).time_since_epoch().count();
  }
  const bool ready = WaitUntil(fd, events, start + std::min<Clock::duration>(left, limit_.stall));
  if (late_since != nullptr) *late_since = 0;
  waited_ += Clock::now() - start;
  return ready;
}

Connection::Read Connection::Fill(Clock::time_point deadline) {
  for (;;) {
    const std::size_t before = in_.size();
    in_.resize(before + kReadBytes);
    const ssize_t count = Receive(fd_, in_.data() + before, kReadBytes);
    in_.resize(before + static_cast<std::size_t>(std::max<ssize_t>(count, 0)));
    if (count > 0) return Read::kDone;
    if (count == 0 || !WouldBlock()) return Read::kClosed;
    if (!WaitUntil(fd_, POLLIN, deadline)) return Read::kTimeout;
  }
}

// A blocking call: the byte is hardly ever there already, and each further system call would delay
// the answer.
Connection::Read Connection::WaitForByte(std::chrono::milliseconds patience) {
  if (!in_.empty()) return Read::kDone;
  if (std::exchange(patience_, patience) != patience) {
    const auto seconds = std::chrono::floor<std::chrono::seconds>(patience);
    const std::chrono::microseconds rest = patience - seconds;
    const timeval limit{.tv_sec = static_cast<time_t>(seconds.count()),
                        .tv_usec = static_cast<suseconds_t>(rest.count())};
    setsockopt(fd_, SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof(limit));
  }
  in_.resize(kReadBytes);
  ssize_t count = 0;
  do {
    count = recv(fd_, in_.data(), kReadBytes, 0);
  } while (count < 0 && errno == EINTR);
  in_.resize(static_cast<std::size_t>(std::max<ssize_t>(count, 0)));
  if (count > 0) return Read::kDone;
  return count < 0 && WouldBlock() ? Read::kTimeout : Read::kClosed;
}

bool Connection::has_head() const { return FindHeadEnd(in_, 0) != 0; }

Connection::Read Connection::ReadHead(Clock::time_point deadline, std::size_t max_bytes) {
  std::size_t looked = 0;
  for (;;) {
    taken_ = head_bytes_ = FindHeadEnd(in_, looked);
    if (head_bytes_ != 0 && head_bytes_ <= max_bytes) return Read::kDone;
    looked = in_.size();
    if (looked >= max_bytes) {
      taken_ = head_bytes_ = std::min(looked, max_bytes);
      return Read::kTooLarge;
    }
    if (const Read read = Fill(deadline); read != Read::kDone) {
      taken_ = head_bytes_ = in_.size();
      return read;
    }
  }
}

void Connection::BeginBody(std::optional<std::uint64_t> bytes, const PaceLimit& pace) {
  body_left_ = bytes.value_or(0);
  body_bytes_ = 0;
  body_failed_ = false;
  if (bytes) {
    chunks_.reset();
  } else {
    chunks_ = ChunkedFraming();
  }
  read_pace_ = Pace(pace);
}

bool Connection::is_body_complete() const {
  return chunks_ ? chunks_->next() == ChunkedFraming::Next::kEnd : body_left_ == 0;
}

Connection::Read Connection::ReadBody(std::span<std::byte> out, std::size_t* count) {
  *count = 0;
  Read read = Read::kDone;
  if (chunks_) {
    read = ReadChunked(out, count);
  } else if (const auto wanted = std::min<std::uint64_t>(out.size(), body_left_); wanted != 0) {
    read = ReadData(out.data(), static_cast<std::size_t>(wanted), count);
    body_left_ -= *count;
  }
  body_failed_ = read != Read::kDone;
  return read;
}

Connection::Read Connection::SkipBody() {
  std::array<std::byte, kChunkedReadBytes> rest;
  while (!is_body_complete()) {
    std::size_t count = 0;
    Read read = Read::kDone;
    if (chunks_) {
      read = ReadChunked(rest, &count);
    } else {
      read = ReadData(nullptr, static_cast<std::size_t>(std::min(body_left_, kMostDroppedBytes)),
                      &count);
      body_left_ -= count;
    }
    body_failed_ = read != Read::kDone;
    if (body_failed_) return read;
  }
  return Read::kDone;
}

// Fills `out` with what has been received, across chunks, because a chunk may have one byte.
Connection::Read Connection::ReadChunked(std::span<std::byte> out, std::size_t* count) {
  while (*count < out.size()) {
    switch (chunks_->next()) {
      case ChunkedFraming::Next::kEnd:
        return Read::kDone;
      case ChunkedFraming::Next::kInvalid:
        return Read::kMalformed;
      case ChunkedFraming::Next::kFraming:
        break;
      case ChunkedFraming::Next::kData: {
        if (!has_buffered_input() && *count > 0) return Read::kDone;
        const auto wanted = static_cast<std::size_t>(
            std::min<std::uint64_t>(out.size() - *count, chunks_->data_left()));
        // A large piece goes past the buffer.
        if (!has_buffered_input() && wanted < kChunkedReadBytes) break;
        std::size_t got = 0;
        if (const Read read = ReadData(&out[*count], wanted, &got); read != Read::kDone) {
          return read;
        }
        chunks_->TakeData(got);
        *count += got;
        continue;
      }
    }
    if (!has_buffered_input()) {
      if (*count > 0) return Read::kDone;
      if (const Read read = FillBody(); read != Read::kDone) return read;
    }
    if (chunks_->next() == ChunkedFraming::Next::kFraming) {
      taken_ += chunks_->Take(std::string_view(in_).substr(taken_));
    }
  }
  return Read::kDone;
}

// Reads data of the body, at least one byte; drops it if `out` is null.
Connection::Read Connection::ReadData(std::byte* out, std::size_t size, std::size_t* count) {
  if (has_buffered_input()) {
    *count = std::min(size, in_.size() - taken_);
    if (out != nullptr) {
      std::copy_n(reinterpret_cast<const std::byte*>(in_.data()) + taken_, *count, out);
    }
    taken_ += *count;
  } else {
    for (;;) {
      const ssize_t got = Receive(fd_, out, size);
      if (got > 0) {
        *count = static_cast<std::size_t>(got);
        break;
      }
      if (got == 0 || !WouldBlock()) return Read::kClosed;
      if (!read_pace_.Wait(fd_, POLLIN, late_since_)) return Read::kTimeout;
    }
  }
  // Only data earns time: framing without data must not keep a thread for ever.
  read_pace_.Moved(*count);
  body_bytes_ += *count;
  return Read::kDone;
}

// Reads bytes of a chunked body, framing included, in place of those that were taken.
Connection::Read Connection::FillBody() {
  taken_ = head_bytes_;
  in_.resize(head_bytes_ + kChunkedReadBytes);
  for (;;) {
    const ssize_t got = Receive(fd_, in_.data() + head_bytes_, kChunkedReadBytes);
    const bool waits = got < 0 && WouldBlock();
    if (waits && read_pace_.Wait(fd_, POLLIN, late_since_)) continue;
    in_.resize(head_bytes_ + static_cast<std::size_t>(std::max<ssize_t>(got, 0)));
    if (got > 0) return Read::kDone;
    return waits ? Read::kTimeout : Read::kClosed;
  }
}

void Connection::BeginWrite(const PaceLimit& pace) {
  write_pace_ = Pace(pace);
  written_ = 0;
}

bool Connection::Write(std::string_view bytes) {
  if (broken_) return false;
  const std::size_t sent_ahead = std::min(ahead_, bytes.size());
  bytes.remove_prefix(sent_ahead);
  ahead_ -= sent_ahead;
  written_ += sent_ahead;
  if (out_.size() + bytes.size() <= kGatherBytes) {
    out_.append(bytes);
    return true;
  }
  const bool sent = Send(out_, true) && Send(bytes, false);
  out_.clear();
  return sent;
}

bool Connection::Flush() {
  const bool sent = Send(out_, false);
  out_.clear();
  return sent;
}

bool Connection::Send(std::string_view bytes, bool more) {
  while (!bytes.empty() && !broken_) {
    const ssize_t count =
        send(fd_, bytes.data(), bytes.size(), MSG_DONTWAIT | MSG_NOSIGNAL | (more ? MSG_MORE : 0));
    if (count > 0) {
      bytes.remove_prefix(static_cast<std::size_t>(count));
      written_ += static_cast<std::uint64_t>(count);
      write_pace_.Moved(static_cast<std::size_t>(count));
    } else if (count < 0 && errno == EINTR) {
      continue;
    } else if (count < 0 && WouldBlock()) {
      broken_ = !write_pace_.Wait(fd_, POLLOUT, late_since_);
    } else {
      broken_ = true;
    }
  }
  return !broken_;
}

bool Connection::SendAhead(std::string_view start) {
  if (ahead_ >= start.size()) return false;
  // With a full buffer or a reset the byte is not sent; a reset is noticed elsewhere.
  if (send(fd_, start.data() + ahead_, 1, MSG_DONTWAIT | MSG_NOSIGNAL) == 1) ++ahead_;
  return true;
}

bool Connection::HasLeft(std::string_view start, std::chrono::milliseconds patience) {
  SendAhead(start);
  return WaitUntil(fd_, 0, Clock::now() + patience);  // for a reset, which poll() always reports
}

void Connection::EndRequest() {
  in_.erase(0, taken_);
  head_bytes_ = taken_ = 0;
}

void Connection::CloseGently() {
  if (broken_) {
    // Data queued for a client that does not read would delay the FIN, and keep the system's
    // memory.
    const linger reset{.l_onoff = 1, .l_linger = 0};
    setsockopt(fd_, SOL_SOCKET, SO_LINGER, &reset, sizeof(reset));
    return;
  }
  if (shutdown(fd_, SHUT_WR) != 0) return;
  const bool has_body = !is_body_complete() && !body_failed_;
  const Linger& limit = has_body ? kBodyLinger : kShortLinger;
  std::uint64_t left = limit.bytes;
  if (has_body && !chunks_)
    left = body_left_ - std::min<std::uint64_t>(body_left_, in_.size() - taken_);
  const auto end = Clock::now() + limit.total;
  while (left > 0) {
    const ssize_t count = Receive(fd_, nullptr, kMostDroppedBytes);
    if (count > 0) {
      left -= std::min(left, static_cast<std::uint64_t>(count));
    } else if (count == 0 || !WouldBlock() ||
               !WaitUntil(fd_, POLLIN, std::min(end, Clock::now() + limit.silence))) {
      return;
    }
    if (Clock::now() >= end) return;
  }
}

}  // namespace kdray::server
