// SPDX-License-Identifier: Apache-2.0
// The `kdray` program as a function, so that tests can run it in their own process.
#pragma once

#include <chrono>
#include <cstddef>
#include <iosfwd>
#include <span>
#include <string>

namespace kdray::client {

/// Exit codes of `kdray`; `kdray --help` prints them. After SIGINT and SIGTERM the shell sees the
/// signal.
enum ExitCode : int {
  kExitOk = 0,
  kExitRefused = 1,       ///< the server answered with an error, printed on standard error
  kExitUsage = 2,         ///< invalid options, or an id that matches no tree or several
  kExitConnection = 3,    ///< no connection, or the connection broke
  kExitLocalFile = 4,     ///< a local file cannot be read or written, or has the wrong format
  kExitClosedPipe = 141,  ///< the reader of standard output has gone; main() ends by SIGPIPE
};

/// The streams of a command: results go to `out` (for pipes), remarks to `err` (for people).
struct Console {
  std::ostream& out;
  std::ostream& err;
  bool out_is_terminal = false;
  bool err_is_terminal = false;  ///< progress is then drawn in place
  std::size_t out_columns = 0;   ///< width of the terminal; 0 if there is none, so no limit
  std::size_t err_columns = 0;
  std::chrono::milliseconds patience{1000};  ///< progress of work that takes less is not shown
};

/// Runs `kdray` with these arguments (without the program's name).
int RunCommand(std::span<const std::string> arguments, Console console);

}  // namespace kdray::client
