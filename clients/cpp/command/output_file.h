// SPDX-License-Identifier: Apache-2.0
// A result file that appears whole or not at all.
#pragma once

#include <stdexcept>
#include <string>
#include <string_view>

#include "clients/cpp/command/command.h"

namespace kdray::client {

/// The reader of standard output has gone (`kdray list | head`). This is not an error: the program
/// ends without a message.
struct ClosedPipe : std::runtime_error {
  ClosedPipe() : std::runtime_error("standard output is closed") {}
};

/// Throws ClosedPipe or LocalFileError if `console.out` could not be written.
void CheckOutput(Console& console);

/// Collects bytes in a temporary file beside `path`, which Commit() renames to `path`; without
/// Commit() no file is left. An existing file that is not regular (/dev/null, a pipe) is written
/// directly. "-" is standard output, which must not be a terminal. All methods throw
/// LocalFileError. So does the constructor, so a file that cannot be written is reported before a
/// long request; Write() throws ClosedPipe too. One object at a time in a process.
class OutputFile {
 public:
  OutputFile(std::string path, Console& console);
  ~OutputFile();
  OutputFile(const OutputFile&) = delete;
  OutputFile& operator=(const OutputFile&) = delete;

  void Write(std::string_view bytes);
  void Commit();

 private:
  [[noreturn]] void Fail() const;

  std::string path_;
  std::string temporary_;  ///< empty when written directly
  int descriptor_ = -1;    ///< -1: to console_.out
  Console& console_;
};

/// SIGINT, SIGTERM and SIGHUP then remove the unfinished file before they end the process.
void RemoveUnfinishedFilesOnSignals();

}  // namespace kdray::client
