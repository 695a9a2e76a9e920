// The `kdray` program as a function, so that tests can run it in their own process.
#pragma once

#include <iosfwd>
#include <span>
#include <string>

namespace kdray::client {

/// Exit codes of `kdray`; `kdray --help` prints them. After SIGINT and SIGTERM the shell sees the
/// signal.
enum ExitCode : int {
  kExitOk = 0,
  kExitRefused = 1,     ///< the server said no; standard error says why
  kExitUsage = 2,       ///< wrong options, or an id that names no tree or several
  kExitConnection = 3,  ///< no connection, or it broke
  kExitLocalFile = 4,   ///< a file here cannot be read or written, or is not what it should be
};

/// Where a command writes: results to `out` (for pipes), talk to `err` (for people).
struct Console {
  std::ostream& out;
  std::ostream& err;
  bool out_is_terminal = false;
  bool err_is_terminal = false;  ///< progress is then drawn in place
};

/// Runs `kdray` with these arguments (without the program's name).
int RunCommand(std::span<const std::string> arguments, Console console);

}  // namespace kdray::client
