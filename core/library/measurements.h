// SPDX-License-Identifier: Apache-2.0
// Results of measurements of meshes (core/tradeoff), and the running one, which is shared by all
// who wait for it.
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

/// Only bookkeeping: Measurer does the work and has the files. Safe from many threads at once.
class Measurements {
 public:
  /// A running measurement, independent of those who wait for it.
  struct Task {
    Sha256Digest mesh;
    CancelToken cancel = CancelToken::Cancellable();
    Progress progress;

   private:
    friend class Measurements;
    bool done_ = false;
  };

  struct Info {
    std::optional<MeasuredTradeoff> measured;  ///< nullopt: measuring
    double progress = 0;                       ///< 0..1
  };

  /// A new task, for the caller to run; null if one is running for the mesh. It replaces the
  /// previous result.
  std::shared_ptr<Task> Begin(const Sha256Digest& mesh);
  /// False after Forget(): the result is not needed any more.
  bool IsWanted(const Task& task);
  /// Gives the result to all who wait, unless the task was forgotten.
  void End(const std::shared_ptr<Task>& task, Result<MeasuredTradeoff> measured) noexcept;

  /// nullopt if there is no measurement, or it was forgotten; the error of the last measurement if
  /// it failed. Waits until it ends, or until `until` or `cancel`.
  Result<std::optional<Info>> Wait(const Sha256Digest& mesh,
                                   std::chrono::steady_clock::time_point until,
                                   const CancelToken& cancel);

  /// Takes a stored result, unless there is one already.
  void Adopt(const Sha256Digest& mesh, MeasuredTradeoff measured);
  /// Stops a running measurement and drops the result; false if there is neither.
  bool Forget(const Sha256Digest& mesh) noexcept;
  /// Stops the running measurement. After it, Begin returns null.
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
