// SPDX-License-Identifier: Apache-2.0
#include "core/library/tree_builder.h"

#include <new>
#include <utility>

#include "core/store/try_to_remove.h"

namespace kdray::core {
namespace {

// Loads are short, and requests wait for them.
WorkQueue::Lane LaneOf(const TreeTask& task) {
  return task.kind == TreeTask::Kind::kLoad ? WorkQueue::Lane::kLoad : WorkQueue::Lane::kBuild;
}

}  // namespace

void TreeBuilder::Start(const std::shared_ptr<TreeTask>& task) {
  parts_.queue->Submit(task->id.mesh, LaneOf(*task), [this, task] { Run(task); });
}

void TreeBuilder::Run(const std::shared_ptr<TreeTask>& task) noexcept {
  // These messages are short enough to need no memory.
  try {
    Bring(*task, &task->watch);
  } catch (const std::bad_alloc&) {
    parts_.registry->GiveUp(*task, Error{ErrorCode::kMemoryFull, "out of memory"});
  } catch (...) {
    parts_.registry->GiveUp(*task, Error{ErrorCode::kInternal, "a failure"});
  }
  // A removal cannot erase what was not in memory yet.
  const std::lock_guard files_lock(parts_.mesh_locks->Of(task->id.mesh));
  parts_.remover->EvictUnwanted(task->id.mesh);
}

void TreeBuilder::Bring(const TreeTask& task, LoadWatch* watch) {
  bool is_counted = false;
  if (task.kind == TreeTask::Kind::kResume && !CountResume(task, &is_counted)) return;
  const std::optional<TreeRecord> record = parts_.registry->RecordOf(task);
  if (!record) return;
  const Result<LoadedScene> loaded = Load(task, *record, watch);
  if (!loaded.ok()) {
    Fail(task, loaded.error());
  } else if (parts_.registry->Succeed(task, *loaded)) {
    // The waiting requests have their answer; after a crash here the tree is built again.
    Store(*record, *loaded);
  }
  if (is_counted) UncountResume(task.id);
}

Result<LoadedScene> TreeBuilder::Load(const TreeTask& task, const TreeRecord& record,
                                      LoadWatch* watch) {
  if (parts_.shared != nullptr) {
    Status brought = parts_.shared->BringFiles(record, watch->cancel);
    if (!brought.ok()) return std::move(brought).error();
  }
  const SceneLoader::Hooks hooks{
      .on_mesh = [&](const MeshFacts& facts) { parts_.registry->NoteParsed(task, facts); },
      .step_aside = [&] { return parts_.queue->StepAside(LaneOf(task)); }};
  return parts_.loader->Load(record, watch, hooks);
}

// Records durably that this start resumes the build, before it does, so the next start knows it if
// the build ends the process. False if the build should not run: its tree was removed, or the disk
// failed and no request has asked for the tree.
bool TreeBuilder::CountResume(const TreeTask& task, bool* is_counted) {
  const std::lock_guard files_lock(parts_.mesh_locks->Of(task.id.mesh));
  std::optional<TreeRecord> record = parts_.registry->RecordOf(task);
  if (!record) return false;
  ++record->resumed;
  *is_counted = parts_.store->SaveRecord(*record).ok();
  return *is_counted ? parts_.registry->NoteResumed(task, record->resumed)
                     : parts_.registry->NoteResumeRefused(task);
}

// After CountResume, when the library shuts down before the build has ended.
void TreeBuilder::UncountResume(const TreeId& id) {
  const std::lock_guard files_lock(parts_.mesh_locks->Of(id.mesh));
  if (!parts_.registry->is_shut_down()) return;
  std::optional<TreeRegistry::Recorded> recorded = parts_.registry->FindRecord(id);
  if (!recorded || recorded->record.tree || recorded->record.resumed == 0) return;
  --recorded->record.resumed;
  (void)parts_.store->SaveRecord(recorded->record);
}

void TreeBuilder::Store(const TreeRecord& before, const LoadedScene& loaded) {
  StoreHere(before, loaded);
  if (parts_.shared == nullptr || (before.tree && !loaded.was_built)) return;
  const auto recorded = parts_.registry->FindRecord(before.id);
  if (recorded) parts_.shared->StoreLater(recorded->record, loaded.tree.build);
}

void TreeBuilder::StoreHere(const TreeRecord& before, const LoadedScene& loaded) {
  const TreeId& id = before.id;
  try {
    parts_.loader->Store(id, loaded, CancelToken::When([this, &id, build = loaded.tree.build] {
                           return !parts_.registry->MayStore(id.mesh, build);
                         }));
  } catch (const std::bad_alloc&) {
    // Derived files are made again when needed; what was written may have to go.
  }
  const std::lock_guard files_lock(parts_.mesh_locks->Of(id.mesh));
  const TreeRegistry::Wanted wanted = parts_.registry->WantedOf(id.mesh);
  // Its tree was removed while the files were written, so they are removed too.
  if (!wanted.mesh) {
    parts_.remover->TryRemoveMeshIfUnused(id.mesh);
  } else if (!wanted.Has(loaded.tree.build)) {
    TryToRemove([&] { parts_.store->RemoveTree(id.mesh, loaded.tree.build); });
  }
  // If the record cannot be written, the stored one says that a build is due; the tree's file will
  // be read instead.
  const std::optional<TreeRegistry::Recorded> recorded = parts_.registry->FindRecord(id);
  if (!recorded || recorded->record == before) return;
  if (parts_.store->SaveRecord(recorded->record).ok()) parts_.registry->ClearDoubt(id);
}

void TreeBuilder::Fail(const TreeTask& task, const Error& error) {
  // Only what this library acknowledged, and nobody can read, is taken from the others: they may
  // read more formats, or have more memory.
  if (FailHere(task, error) && parts_.shared != nullptr) parts_.shared->RemoveLater(task.id);
}

// Whether a tree that was new here is gone for good.
bool TreeBuilder::FailHere(const TreeTask& task, const Error& error) {
  const std::lock_guard files_lock(parts_.mesh_locks->Of(task.id.mesh));
  std::optional<TreeRegistry::NewFailure> failure = parts_.registry->Judge(task, error);
  if (!failure) return false;
  const bool is_of_new_tree = failure->is_of_new_tree();
  // A record that the disk does not let go keeps its tree.
  if (failure->is_for_good() && parts_.remover->RemoveRecord(task.id).ok()) {
    Error told = failure->TakeError();
    parts_.registry->FailForGood(*std::move(failure));
    parts_.remover->RemoveTree(task.id, std::move(told));
    return is_of_new_tree && error.code != ErrorCode::kMeshTooLarge;
  }
  parts_.registry->FailForNow(task, *std::move(failure));
  return false;
}

}  // namespace kdray::core
