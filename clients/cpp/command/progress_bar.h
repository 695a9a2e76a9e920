// SPDX-License-Identifier: Apache-2.0
// Shows how far long work is, how fast it goes, and how long it still takes.
#pragma once

#include <chrono>
#include <condition_variable>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "clients/cpp/command/command.h"

namespace kdray::client {

/// What is counted: bytes, or things with a name ("rays").
struct ProgressUnit {
  std::string name;    ///< "rays"; "" if the work is only a share of 1
  bool bytes = false;  ///< shown as "2.9 MiB"

  static ProgressUnit Bytes() { return {.name = "B", .bytes = true}; }
};

/// On a terminal, one line that is redrawn, and erased at the end; it does not appear for work that
/// ends within a third of console.patience. Elsewhere a line at every tenth that is reached, once
/// the work has taken console.patience, so a log stays short. A thread redraws it, so it moves
/// during a wait that reports nothing. The methods are for one thread.
class ProgressBar {
 public:
  /// @param label the activity: "uploading"; @param total in `unit`; 0 if unknown.
  ProgressBar(Console& console, std::string label, double total, ProgressUnit unit, bool quiet);
  ~ProgressBar() { Finish(); }
  ProgressBar(const ProgressBar&) = delete;
  ProgressBar& operator=(const ProgressBar&) = delete;

  /// `done` in the unit, of the total; the first call starts the clock. Values below an earlier one
  /// are ignored.
  void Update(double done);

  /// Work that reports nothing and takes about so long; without a duration only the time that has
  /// passed is shown. Starts the clock.
  void Expect(std::optional<std::chrono::duration<double>> duration);

  /// Erases the line. Later calls have no effect.
  void Finish();

 private:
  using Clock = std::chrono::steady_clock;

  void Start();                                                // the caller holds mutex_
  void Draw();                                                 // the caller holds mutex_
  double Fraction() const;                                     // 0..1; negative if unknown
  std::string Line(double fraction, std::size_t width) const;  // no bar where there is no room

  Console& console_;
  const std::string label_;
  const double total_;
  const ProgressUnit unit_;
  const bool quiet_;

  std::mutex mutex_;  // of what follows, and of console_.err while the thread runs
  std::condition_variable wake_;
  bool finished_ = false;
  bool drawn_ = false;
  int last_tenth_ = 0;
  double done_ = 0;
  bool reports_ = true;
  double expected_s_ = 0;
  Clock::time_point started_;
  Clock::time_point updated_;
  std::thread thread_;
};

}  // namespace kdray::client
