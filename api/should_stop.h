// SPDX-License-Identifier: Apache-2.0
// How a caller ends long work here when its result is no longer wanted.
#pragma once

#include <cstdint>
#include <functional>
#include <utility>

namespace kdray::api {

/// Called now and then from the calling thread. True ends the work. An empty one never does.
using ShouldStop = std::function<bool()>;

/// Calls a ShouldStop once in kRowsPerLook rows.
class StopPoll {
 public:
  explicit StopPoll(ShouldStop should_stop) : should_stop_(std::move(should_stop)) {}

  /// Counts a row. Returns whether it is time to stop; once true, always true.
  bool Row() {
    if (rows_++ % kRowsPerLook == 0 && should_stop_ && should_stop_()) stopped_ = true;
    return stopped_;
  }
  bool stopped() const { return stopped_; }

 private:
  static constexpr std::uint64_t kRowsPerLook = 1024;

  ShouldStop should_stop_;
  std::uint64_t rows_ = 0;
  bool stopped_ = false;
};

}  // namespace kdray::api
