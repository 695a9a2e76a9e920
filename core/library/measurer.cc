// SPDX-License-Identifier: Apache-2.0
#include "core/library/measurer.h"

#include <new>
#include <utility>

namespace kdray::core {
namespace {

// Jobs of one key run one after the other. With this key, which belongs to no mesh, one measurement
// runs at a time, in parallel with work on any mesh.
constexpr Sha256Digest kMeasuringKey{};

std::int64_t NowMs() {
  return std::chrono::duration_cast<std::chrono::milliseconds>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

}  // namespace

Status Measurer::Measure(const TreeId& id, TradeoffOptions options) {
  if (Status status = parts_.registry->Check(id); !status.ok()) return status;
  if (parts_.registry->is_shut_down()) return Error{ErrorCode::kCancelled, "shutting down"};
  if (std::shared_ptr<Measurements::Task> task = parts_.measurements->Begin(id.mesh)) {
    try {
      parts_.queue->Submit(
          kMeasuringKey, WorkQueue::Lane::kBuild,
          [this, id, task, options = std::move(options)] { Run(id, task, options); });
    } catch (...) {
      parts_.measurements->Forget(id.mesh);  // no task will run it
      throw;
    }
  }
  return {};
}

void Measurer::Run(const TreeId& id, const std::shared_ptr<Measurements::Task>& task,
                   const TradeoffOptions& options) noexcept {
  // These messages are short enough to need no memory.
  Result<MeasuredTradeoff> measured = Error{ErrorCode::kInternal, "a failure"};
  try {
    measured = MeasureNow(id, options, task.get());
    // Stored before it is answered, so it exists after a restart.
    const std::lock_guard files_lock(parts_.mesh_locks->Of(id.mesh));
    if (measured.ok() && parts_.measurements->IsWanted(*task)) {
      parts_.store->WriteTradeoff(id.mesh, *measured);
    }
  } catch (const std::bad_alloc&) {
    measured = Error{ErrorCode::kMemoryFull, "out of memory"};
  } catch (...) {
    measured = Error{ErrorCode::kInternal, "a failure"};
  }
  parts_.measurements->End(task, std::move(measured));
}

Result<MeasuredTradeoff> Measurer::MeasureNow(const TreeId& id, TradeoffOptions options,
                                              Measurements::Task* task) {
  options.threads = parts_.arena->threads();
  options.is_disturbed = [this, asked = std::move(options.is_disturbed)] {
    return (asked && asked()) || parts_.registry->IsAnyUnderWay();
  };
  Result<Scene> scene = [&]() -> Result<Scene> {
    // Another job of the queue may have to load the tree; it uses this place meanwhile.
    const std::optional<WorkQueue::Aside> aside = parts_.queue->StepAside(WorkQueue::Lane::kBuild);
    if (!aside) return Error{ErrorCode::kMemoryFull, "too much other work waits already"};
    return parts_.load(id, task->cancel);
  }();
  if (!scene.ok()) return std::move(scene).error();
  const Result<TreeInfo> info = parts_.registry->Info(id);
  if (!info.ok()) return info.error();
  const bool closed = info->record.mesh && info->record.mesh->health.closed;
  // Does not wait: waiting for memory while holding a mesh could deadlock with work that waits for
  // the mesh.
  const std::optional<MemoryCharge> charge =
      parts_.budget->TryReserve(EstimateTradeoffBytes(scene->mesh->triangle_count(), options));
  if (!charge) return Error{ErrorCode::kMemoryFull, "there is no memory for measuring now"};
  scene->tree.reset();
  std::optional<Result<Tradeoff>> tradeoff;
  parts_.arena->Run([&] {
    tradeoff = MeasureTradeoff(scene->mesh, closed, options, task->cancel, &task->progress);
  });
  if (!tradeoff->ok()) return std::move(*tradeoff).error();
  return MeasuredTradeoff{NowMs(), *std::move(*tradeoff)};
}

Result<std::optional<Measurements::Info>> Measurer::Wait(
    const TreeId& id, std::chrono::steady_clock::time_point until, const CancelToken& cancel) {
  if (Status status = parts_.registry->Check(id); !status.ok()) return std::move(status).error();
  auto info = parts_.measurements->Wait(id.mesh, until, cancel);
  if (!info.ok() || info->has_value()) return info;
  {
    // The result may be stored from before the last start.
    const std::lock_guard files_lock(parts_.mesh_locks->Of(id.mesh));
    Result<MeasuredTradeoff> stored = parts_.store->ReadTradeoff(id.mesh);
    if (stored.ok()) parts_.measurements->Adopt(id.mesh, *std::move(stored));
  }
  // One may have begun meanwhile, so this waits too, and others need the lock.
  return parts_.measurements->Wait(id.mesh, until, cancel);
}

Result<bool> Measurer::Forget(const TreeId& id) {
  if (Status status = parts_.registry->Check(id); !status.ok()) return std::move(status).error();
  const std::lock_guard files_lock(parts_.mesh_locks->Of(id.mesh));
  const bool was_stored = parts_.store->HasTradeoff(id.mesh);
  if (Status removed = parts_.store->RemoveTradeoff(id.mesh); !removed.ok()) {
    return std::move(removed).error();
  }
  return parts_.measurements->Forget(id.mesh) || was_stored;
}

}  // namespace kdray::core
