// SPDX-License-Identifier: Apache-2.0
// The events of tasks in TreeRegistry, from the first step to success or failure.
#include <algorithm>
#include <utility>

#include "core/library/tree_registry.h"

namespace kdray::core {
namespace {

// The same bytes would fail the same way.
bool IsMeshsFault(ErrorCode code) {
  return code == ErrorCode::kInvalidMesh || code == ErrorCode::kEmptyMesh ||
         code == ErrorCode::kUnsupportedMeshFormat;
}

}  // namespace

std::optional<TreeRecord> TreeRegistry::RecordOf(const TreeTask& task) const {
  const std::lock_guard lock(mutex_);
  const Entry* entry = EntryOf(task);
  if (entry == nullptr) return std::nullopt;
  return entry->record;
}

bool TreeRegistry::NoteResumed(const TreeTask& task, std::uint32_t resumed) {
  const std::lock_guard lock(mutex_);
  Entry* entry = EntryOf(task);
  if (entry == nullptr) return false;
  entry->record.resumed = resumed;
  return true;
}

bool TreeRegistry::NoteResumeRefused(const TreeTask& task) {
  const std::lock_guard lock(mutex_);
  Entry* entry = EntryOf(task);
  if (entry == nullptr) return false;
  if (entry->task->is_asked_for_) return true;
  EndTask(entry, std::nullopt, std::nullopt);  // no request waits for it
  return false;
}

void TreeRegistry::NoteParsed(const TreeTask& task, const MeshFacts& facts) {
  const std::lock_guard lock(mutex_);
  if (Entry* entry = EntryOf(task)) entry->record.mesh = facts;
}

bool TreeRegistry::Succeed(const TreeTask& task, const LoadedScene& loaded) {
  const std::lock_guard lock(mutex_);
  Entry* entry = EntryOf(task);
  if (entry == nullptr) return false;
  TreeRecord& record = entry->record;
  TreeFacts facts = loaded.tree;  // what takes memory comes first
  std::optional<MeshFacts> mesh_facts = loaded.parsed->facts;
  if (!loaded.was_built && !record.tree) {
    // The tree exists under another id, which has its build time.
    ForEachOf(record.id.mesh, [&](const Entry& other) {
      const std::optional<TreeFacts>& tree = other.record.tree;
      if (tree && tree->build == facts.build) facts.build_ms = tree->build_ms;
    });
  }
  if (record.tree && loaded.was_built) ++rebuilds_;
  record.resumed = 0;
  record.mesh = std::move(mesh_facts);
  record.tree = std::move(facts);
  record.choice = loaded.choice;
  entry->failure.reset();
  EndTask(entry, loaded.scene, std::nullopt);
  return true;
}

std::optional<TreeRegistry::NewFailure> TreeRegistry::Judge(const TreeTask& task,
                                                            const Error& error) {
  const std::lock_guard lock(mutex_);
  const Entry* entry = EntryOf(task);
  if (entry == nullptr) return std::nullopt;
  NewFailure failure;
  failure.for_good_ =
      !entry->record.tree &&
      (IsMeshsFault(error.code) || (error.code == ErrorCode::kMeshTooLarge && entry->is_new));
  failure.is_new_ = entry->is_new;
  const Clock::time_point now = now_();
  failure.kept_[task.id] = Failure{error, now + rules_.keep_failure};
  failure.passing_ = {error, now + (failure.for_good_ ? rules_.keep_failure : rules_.retry_after)};
  failure.told_ = error;
  if (error.code == ErrorCode::kCorrupt) damaged_meshes_.insert(task.id.mesh);
  return failure;
}

void TreeRegistry::FailForGood(NewFailure failure) {
  const std::lock_guard lock(mutex_);
  MakeRoomForFailure();
  failures_.erase(failure.kept_.begin()->first);
  failures_.insert(failure.kept_.extract(failure.kept_.begin()));
}

void TreeRegistry::FailForNow(const TreeTask& task, NewFailure failure) {
  const std::lock_guard lock(mutex_);
  Entry* entry = EntryOf(task);
  if (entry == nullptr) return;
  entry->failure = std::move(failure.passing_);
  EndTask(entry, std::nullopt, std::move(failure.told_));
}

void TreeRegistry::GiveUp(const TreeTask& task, Error error) noexcept {
  const std::lock_guard lock(mutex_);
  Entry* entry = EntryOf(task);
  if (entry == nullptr) return;
  entry->failure = Failure{error, now_() + rules_.retry_after};
  EndTask(entry, std::nullopt, std::move(error));
}

void TreeRegistry::MakeRoomForFailure() {
  if (failures_.size() < rules_.max_failures) return;
  const Clock::time_point now = now_();
  std::erase_if(failures_, [&](const auto& failure) { return failure.second.until <= now; });
  if (failures_.size() >= rules_.max_failures) failures_.erase(failures_.begin());
}

}  // namespace kdray::core
