// How far an upload or a build has come.
#pragma once

#include <chrono>
#include <cstdint>
#include <string>

#include "clients/cpp/command/command.h"

namespace kdray::client {

/// On a terminal one line that is redrawn and erased at the end; elsewhere a line every ten
/// percent, so that a log stays short. Nothing is shown for what ends within a third of a second on
/// a terminal.
class ProgressBar {
 public:
  /// @param label what is done: "uploading"; @param total_bytes 0 when progress is not in bytes.
  ProgressBar(Console& console, std::string label, std::uint64_t total_bytes, bool quiet);
  ~ProgressBar() { Finish(); }
  ProgressBar(const ProgressBar&) = delete;
  ProgressBar& operator=(const ProgressBar&) = delete;

  /// `fraction` in [0, 1]; what lies outside is cut to it.
  void Update(double fraction);

  /// Takes the line off the terminal. Later calls do nothing.
  void Finish();

 private:
  using Clock = std::chrono::steady_clock;

  void Draw(double fraction, Clock::time_point now);

  Console& console_;
  std::string label_;
  std::uint64_t total_bytes_;
  bool quiet_;
  bool drawn_ = false;
  int last_tenth_ = -1;
  Clock::time_point started_ = Clock::now();
  Clock::time_point last_drawn_ = {};
};

}  // namespace kdray::client
