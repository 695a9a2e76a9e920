// What was measured on meshes (core/tradeoff), and what is being measured: one at a time, shared by
// all who wait for it.
#pragma once

#include <chrono>
#include <condition_variable>
#include <map>
#include <memory>
#include <mutex>
#include <optional>

#include "core/base/cancel.h"
#include "core/base/hash.h"
#include "core/base/progress.h"
#include "core/base/result.h"
#include "core/catalog/records.h"

namespace kdray::core {

/// Bookkeeping only: TreeLibrary does the work and keeps the files. Safe from many threads at once.
class Measurements {
 public:
  /// A measuring under way. It belongs to none of those who wait.
  struct Task {
    Sha256Digest mesh;
    CancelToken cancel = CancelToken::Cancellable();
    Progress progress;

   private:
    friend class Measurements;
    bool done_ = false;
  };

  struct Info {
    std::optional<MeasuredTradeoff> measured;  ///< none: it is being measured
    double progress = 0;                       ///< 0..1
  };

  /// A new task, for the caller to run; null when one is under way for the mesh. It takes the place
  /// of what was measured before.
  std::shared_ptr<Task> Begin(const Sha256Digest& mesh);
  /// False once the task was forgotten: then nobody wants what it makes.
  bool IsWanted(const Task& task);
  /// Tells all who wait, unless the task was forgotten meanwhile.
  void End(const std::shared_ptr<Task>& task, Result<MeasuredTradeoff> measured) noexcept;

  /// Nothing when nobody asked for it, or it was forgotten; the error of the latest measuring if it
  /// failed. Waits until it ends, or `until` or `cancel` comes.
  Result<std::optional<Info>> Wait(const Sha256Digest& mesh,
                                   std::chrono::steady_clock::time_point until,
                                   const CancelToken& cancel);

  /// What was stored, unless something is known already.
  void Adopt(const Sha256Digest& mesh, MeasuredTradeoff measured);
  /// Stops what is under way, and drops what is there; false when there is neither.
  bool Forget(const Sha256Digest& mesh) noexcept;
  /// Stops all that is under way. Begin gives nothing new after it.
  void Stop();

 private:
  struct Entry {
    std::shared_ptr<Task> task;
    std::optional<Result<MeasuredTradeoff>> ended;
  };
  void Land(Task* task);  // with mutex_ held

  std::mutex mutex_;
  std::condition_variable landed_;
  std::map<Sha256Digest, Entry> entries_;
  bool stopped_ = false;
};

}  // namespace kdray::core
