// A result file that appears whole or not at all.
#pragma once

#include <string>
#include <string_view>

#include "clients/cpp/command/command.h"

namespace kdray::client {

/// Collects bytes in a temporary file beside `path` and gives it the name when Commit() is called;
/// without Commit() nothing is left. What is there and no regular file (/dev/null, a pipe) is
/// written directly. "-" is standard output, which is refused when it is a terminal.
/// All throw LocalFileError; so does the constructor, so that a file that cannot be written is told
/// before a long request. One at a time in a process.
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
