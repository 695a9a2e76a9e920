// Shows the progress of an upload or a build.
#pragma once

#include <chrono>
#include <cstdint>
#include <string>

#include "clients/cpp/command/command.h"

namespace kdray::client {

/// On a terminal, one line that is redrawn, and erased at the end; it does not appear for work that
/// ends within a third of a second. Elsewhere a line every ten percent, so a log stays short.
class ProgressBar {
 public:
  /// @param label the activity: "uploading"; @param total_bytes 0 if progress is not in bytes.
  ProgressBar(Console& console, std::string label, std::uint64_t total_bytes, bool quiet);
  ~ProgressBar() { Finish(); }
  ProgressBar(const ProgressBar&) = delete;
  ProgressBar& operator=(const ProgressBar&) = delete;

  /// `fraction` is clamped to [0, 1].
  void Update(double fraction);

  /// Erases the line. Later calls have no effect.
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
