// SPDX-License-Identifier: Apache-2.0
// Writes the log's lines (log.h).
#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <string_view>

namespace kdray::server {

/// Writes lines to a file descriptor that other processes share: a pipe, a socket, a terminal, a
/// file. Does not change O_NONBLOCK, which would affect all of them. Used by one thread, except for
/// Stop().
class LineSink {
 public:
  using Clock = std::chrono::steady_clock;
  /// After Stop(): the longest wait for a reader that takes nothing, and for all remaining lines.
  static constexpr std::chrono::milliseconds kStallTime{500};
  static constexpr std::chrono::milliseconds kStopTime{3000};

  /// The descriptor must outlive the sink.
  explicit LineSink(int fd);

  /// Writes the line, which ends with '\n', and waits for the reader until Stop(). False if it
  /// could not be written: the reader has gone, the disk is full, or the time after Stop() is over.
  bool Write(std::string_view line) noexcept;
  /// Limits the wait for the reader from now on. From any thread.
  void Stop() noexcept;

 private:
  bool WriteAll(std::string_view bytes) noexcept;
  bool WaitUntilWritable() const noexcept;
  long WriteSome(std::string_view bytes) const noexcept;

  const int fd_;
  const bool is_socket_, is_pipe_;
  bool gave_up_ = false;
  bool is_cut_ = false;  ///< the last line was only partly written
  std::atomic<bool> stopping_{false};
  std::atomic<Clock::time_point> stop_by_{Clock::time_point::max()};
};

}  // namespace kdray::server
