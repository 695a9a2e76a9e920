// Entry of the `kdray` command: only signals and streams.
#include <unistd.h>

#include <csignal>
#include <iostream>
#include <string>
#include <vector>

#include "clients/cpp/command/command.h"
#include "clients/cpp/command/output_file.h"

int main(int argc, char** argv) {
  // If the server closes while we send, report an error instead of ending the process.
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
