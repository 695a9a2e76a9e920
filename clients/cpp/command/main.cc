// Entry of the `kdray` command: the process's own affairs (signals, streams) and nothing else.
#include <unistd.h>

#include <csignal>
#include <iostream>
#include <string>
#include <vector>

#include "clients/cpp/command/command.h"
#include "clients/cpp/command/output_file.h"

int main(int argc, char** argv) {
  // A server that closes while we send must be an error to report, not the end of the process.
  std::signal(SIGPIPE, SIG_IGN);
  kdray::client::RemoveUnfinishedFilesOnSignals();
  const std::vector<std::string> arguments(argv + 1, argv + argc);
  try {
    return kdray::client::RunCommand(arguments, {.out = std::cout,
                                                 .err = std::cerr,
                                                 .out_is_terminal = isatty(STDOUT_FILENO) == 1,
                                                 .err_is_terminal = isatty(STDERR_FILENO) == 1});
  } catch (const std::exception& error) {  // e.g. no memory for an answer
    std::cerr << "kdray: " << error.what() << "\n";
    return kdray::client::kExitLocalFile;
  }
}
