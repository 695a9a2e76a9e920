// SPDX-License-Identifier: Apache-2.0
// Entry of the `kdray` command: only signals and streams.
#include <fcntl.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <csignal>
#include <iostream>
#include <string>
#include <vector>

#include "clients/cpp/command/command.h"
#include "clients/cpp/command/output_file.h"

namespace {

// Columns of the terminal of a descriptor; 0 if it is not one.
std::size_t ColumnsOf(int descriptor) {
  if (isatty(descriptor) != 1) return 0;
  winsize size{};
  if (ioctl(descriptor, TIOCGWINSZ, &size) == 0 && size.ws_col > 0) return size.ws_col;
  return 80;
}

// Opens /dev/null in place of each standard stream that is closed. Otherwise the next file or
// connection would get its number, and results would be written into it.
void OpenStandardStreams() {
  for (const int stream : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO}) {
    if (fcntl(stream, F_GETFD) >= 0) continue;
    if (open("/dev/null", O_RDWR) != stream) return;  // the lowest number that is free
  }
}

}  // namespace

int main(int argc, char** argv) {
  OpenStandardStreams();
  // If the server closes while we send, report an error instead of ending the process.
  std::signal(SIGPIPE, SIG_IGN);
  kdray::client::RemoveUnfinishedFilesOnSignals();
  const std::vector<std::string> arguments(argv + 1, argv + argc);
  try {
    const int code =
        kdray::client::RunCommand(arguments, {.out = std::cout,
                                              .err = std::cerr,
                                              .out_is_terminal = isatty(STDOUT_FILENO) == 1,
                                              .err_is_terminal = isatty(STDERR_FILENO) == 1,
                                              .out_columns = ColumnsOf(STDOUT_FILENO),
                                              .err_columns = ColumnsOf(STDERR_FILENO)});
    if (code != kdray::client::kExitClosedPipe) return code;
    // As every program ends whose reader has gone; the shell sees the signal.
    std::signal(SIGPIPE, SIG_DFL);
    std::raise(SIGPIPE);
    return code;
  } catch (const std::exception& error) {  // e.g. no memory for an answer
    std::cerr << "kdray: " << error.what() << "\n";
    return kdray::client::kExitLocalFile;
  }
}
