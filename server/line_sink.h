// Where the thread that writes the log puts its lines (log.h).
#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <string_view>

namespace kdray::server {

/// Writes lines to a file descriptor that belongs to others too: a pipe, a socket, a terminal, a
/// file. Its O_NONBLOCK is a matter of everyone who shares it and stays as it is. Used by one
/// thread, except for Stop().
class LineSink {
 public:
  using Clock = std::chrono::steady_clock;
  /// After Stop(): the longest wait for a reader that takes nothing, and for all that is left.
  static constexpr std::chrono::milliseconds kStallTime{500};
  static constexpr std::chrono::milliseconds kStopTime{3000};

  /// The descriptor must outlive the sink.
  explicit LineSink(int fd);

  /// Writes the line, which ends with its '\n', and waits for the reader until Stop(). False when
  /// it could not be written: the reader has gone, the disk is full, or it is too late.
  bool Write(std::string_view line) noexcept;
  /// From now on the reader's time is limited. From any thread.
  void Stop() noexcept;

 private:
  bool WriteAll(std::string_view bytes) noexcept;
  bool WaitUntilWritable() const noexcept;
  long WriteSome(std::string_view bytes) const noexcept;

  const int fd_;
  const bool is_socket_, is_pipe_;
  bool gave_up_ = false;
  bool is_cut_ = false;  ///< the last line was written in part
  std::atomic<bool> stopping_{false};
  std::atomic<Clock::time_point> stop_by_{Clock::time_point::max()};
};

}  // namespace kdray::server
