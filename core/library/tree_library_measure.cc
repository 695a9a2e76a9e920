// The measuring side of TreeLibrary.
#include <algorithm>
#include <new>
#include <utility>

#include "core/library/tree_library.h"

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

Status TreeLibrary::Measure(const TreeId& id, TradeoffOptions options) {
  {
    const std::lock_guard lock(mutex_);
    const Result<Entry*> entry = FindLocked(id);
    if (!entry.ok()) return entry.error();
    if (shut_down_) return Error{ErrorCode::kCancelled, "shutting down"};
  }
  if (std::shared_ptr<Measurements::Task> task = measurements_.Begin(id.mesh)) {
    try {
      queue_.Submit(
          kMeasuringKey, WorkQueue::Lane::kBuild,
          [this, id, task, options = std::move(options)] { RunMeasuring(id, task, options); });
    } catch (...) {
      measurements_.Forget(id.mesh);  // it will not run
      throw;
    }
  }
  return {};
}

void TreeLibrary::RunMeasuring(const TreeId& id, const std::shared_ptr<Measurements::Task>& task,
                               const TradeoffOptions& options) noexcept {
  // These messages are short enough to need no memory.
  Result<MeasuredTradeoff> measured = Error{ErrorCode::kInternal, "a failure"};
  try {
    measured = MeasureNow(id, options, task.get());
    // Stored before it is answered, so it exists after a restart.
    const std::lock_guard files_lock(MeshMutex(id.mesh));
    if (measured.ok() && measurements_.IsWanted(*task)) store_->WriteTradeoff(id.mesh, *measured);
  } catch (const std::bad_alloc&) {
    measured = Error{ErrorCode::kMemoryFull, "out of memory"};
  } catch (...) {
    measured = Error{ErrorCode::kInternal, "a failure"};
  }
  measurements_.End(task, std::move(measured));
}

Result<MeasuredTradeoff> TreeLibrary::MeasureNow(const TreeId& id, TradeoffOptions options,
                                                 Measurements::Task* task) {
  options.threads = arena_.threads();
  options.is_disturbed = [this, asked = std::move(options.is_disturbed)] {
    if (asked && asked()) return true;
    const std::lock_guard lock(mutex_);
    return std::any_of(entries_.begin(), entries_.end(),
                       [](const auto& entry) { return entry.second.flight != nullptr; });
  };
  Result<Scene> scene = [&]() -> Result<Scene> {
    // Another job of the queue may have to load the tree; it uses this place meanwhile.
    const std::optional<WorkQueue::Aside> aside = queue_.StepAside(WorkQueue::Lane::kBuild);
    if (!aside) return Error{ErrorCode::kMemoryFull, "too much other work waits already"};
    return Load(id, task->cancel);
  }();
  if (!scene.ok()) return std::move(scene).error();
  const Result<TreeInfo> info = Find(id);
  if (!info.ok()) return info.error();
  const bool closed = info->record.mesh && info->record.mesh->health.closed;
  // Does not wait: waiting for memory while holding a mesh could deadlock with work that waits for
  // the mesh.
  const std::optional<MemoryCharge> charge =
      budget_.TryReserve(EstimateTradeoffBytes(scene->mesh->triangle_count(), options));
  if (!charge) return Error{ErrorCode::kMemoryFull, "there is no memory for measuring now"};
  scene->tree.reset();
  std::optional<Result<Tradeoff>> tradeoff;
  arena_.Run([&] {
    tradeoff = MeasureTradeoff(scene->mesh, closed, options, task->cancel, &task->progress);
  });
  if (!tradeoff->ok()) return std::move(*tradeoff).error();
  return MeasuredTradeoff{NowMs(), *std::move(*tradeoff)};
}

Result<std::optional<Measurements::Info>> TreeLibrary::WaitForMeasured(
    const TreeId& id, std::chrono::steady_clock::time_point until, const CancelToken& cancel) {
  {
    const std::lock_guard lock(mutex_);
    const Result<Entry*> entry = FindLocked(id);
    if (!entry.ok()) return entry.error();
  }
  auto info = measurements_.Wait(id.mesh, until, cancel);
  if (!info.ok() || info->has_value()) return info;
  {
    // The result may be stored from before the last start.
    const std::lock_guard files_lock(MeshMutex(id.mesh));
    Result<MeasuredTradeoff> stored = store_->ReadTradeoff(id.mesh);
    if (stored.ok()) measurements_.Adopt(id.mesh, *std::move(stored));
  }
  // A measurement may have begun meanwhile, so this waits too, without the mutex.
  return measurements_.Wait(id.mesh, until, cancel);
}

Result<bool> TreeLibrary::ForgetMeasured(const TreeId& id) {
  {
    const std::lock_guard lock(mutex_);
    const Result<Entry*> entry = FindLocked(id);
    if (!entry.ok()) return entry.error();
  }
  const std::lock_guard files_lock(MeshMutex(id.mesh));
  const bool was_stored = store_->HasTradeoff(id.mesh);
  if (Status removed = store_->RemoveTradeoff(id.mesh); !removed.ok()) {
    return std::move(removed).error();
  }
  return measurements_.Forget(id.mesh) || was_stored;
}

}  // namespace kdray::core
