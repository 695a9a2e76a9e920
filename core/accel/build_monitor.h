// SPDX-License-Identifier: Apache-2.0
// The builders' connection to their caller: cancellation and progress.
#pragma once

#include <atomic>

#include "core/accel/build_options.h"
#include "core/base/cancel_poll.h"

namespace kdray::core {

/// One build's cancellation and progress. Safe from many threads at once.
class BuildMonitor {
 public:
  explicit BuildMonitor(const BuildOptions& options) : options_(options) {}

  /// Checks the token, so call it once per piece of work, which is a few thousand references. Once
  /// true it stays true; the caller may then return anything, because the tree is discarded.
  bool ShouldStop() {
    if (stopped_.load(std::memory_order_relaxed)) return true;
    if (!options_.cancel.ShouldStop()) return false;
    stopped_.store(true, std::memory_order_relaxed);
    return true;
  }

  /// For a thread's loop over more than one piece.
  CancelPoll MakePoll() const { return CancelPoll(options_.cancel); }
  const CancelToken& cancel() const { return options_.cancel; }

  /// Adds `share`, a fraction of the whole build. Each node divides its share among its children in
  /// proportion to their references.
  void AddDone(double share) {
    if (options_.progress != nullptr) options_.progress->Add(share);
  }

  /// Success, or the reason why the build stopped.
  Status Finish() {
    if (ShouldStop()) return options_.cancel.ToError();
    if (options_.progress != nullptr) options_.progress->Finish();
    return {};
  }

 private:
  const BuildOptions& options_;
  std::atomic<bool> stopped_{false};
};

}  // namespace kdray::core
