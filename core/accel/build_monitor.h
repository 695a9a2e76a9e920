// What the builders tell the outside while they work, and hear from it.
#pragma once

#include <atomic>

#include "core/accel/build_options.h"
#include "core/base/cancel_poll.h"

namespace kdray::core {

/// One build's cancellation and progress. Safe from many threads at once.
class BuildMonitor {
 public:
  explicit BuildMonitor(const BuildOptions& options) : options_(options) {}

  /// Looks at the token, so call it once per piece of work, which is a few thousand references.
  /// Once true it stays true; the caller then returns whatever is quickest, since the tree is
  /// thrown away.
  bool ShouldStop() {
    if (stopped_.load(std::memory_order_relaxed)) return true;
    if (!options_.cancel.ShouldStop()) return false;
    stopped_.store(true, std::memory_order_relaxed);
    return true;
  }

  /// For one thread's loop over more than a piece.
  CancelPoll MakePoll() const { return CancelPoll(options_.cancel); }
  const CancelToken& cancel() const { return options_.cancel; }

  /// Of the whole build the fraction `share` is done: each node hands its share to its children in
  /// proportion to their references.
  void AddDone(double share) {
    if (options_.progress != nullptr) options_.progress->Add(share);
  }

  /// Success, or the reason why the build stopped: whatever was left out was left out for that.
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
