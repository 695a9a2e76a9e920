// SPDX-License-Identifier: Apache-2.0
// The daemon as a process of its own, as a user starts it.
#pragma once

#include <sys/types.h>

#include <chrono>
#include <optional>
#include <string>
#include <vector>

namespace kdray::test {

class Daemon {
 public:
  /// Starts kdrayd with the given options; `environment` holds NAME=VALUE, and `closed` is a
  /// standard stream that it starts without.
  explicit Daemon(std::vector<std::string> options, std::vector<std::string> environment = {},
                  std::optional<int> closed = std::nullopt);
  /// Kills it when it still runs.
  ~Daemon();
  Daemon(const Daemon&) = delete;
  Daemon& operator=(const Daemon&) = delete;

  /// Waits for the line that says it serves, and takes the port from it; none when it ended
  /// instead.
  std::optional<int> WaitForPort(std::chrono::seconds timeout = std::chrono::seconds(60));
  void Signal(int signal);
  /// Leaves what it logs unread, in a pipe as small as can be, until errors() is asked for again.
  void StopReadingErrors();
  /// The reader of its log goes.
  void CloseErrors();
  /// Its exit code, or -1 when a signal ended it, or -2 when it did not end in time.
  int WaitForExit(std::chrono::seconds timeout = std::chrono::seconds(60));
  /// Everything that it wrote so far.
  std::string output();
  std::string errors();

 private:
  static void Drain(int fd, std::string& text);

  pid_t pid_ = -1;
  int out_ = -1, err_ = -1;
  bool reads_errors_ = true;
  std::string out_text_, err_text_;
  std::optional<int> exit_code_;
};

}  // namespace kdray::test
