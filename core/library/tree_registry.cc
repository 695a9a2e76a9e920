// SPDX-License-Identifier: Apache-2.0
#include "core/library/tree_registry.h"

#include <algorithm>

#include "core/accel/auto_choice.h"

namespace kdray::core {
namespace {

Error NoSuchTree() { return Error{ErrorCode::kNotFound, "no tree has this id"}; }
// Short enough to need no memory.
Error ShuttingDown() { return Error{ErrorCode::kCancelled, "shutting down"}; }

}  // namespace

void TreeRegistry::Adopt(std::vector<TreeRecord> records, std::set<Sha256Digest> damaged_meshes) {
  const std::lock_guard lock(mutex_);
  damaged_meshes_ = std::move(damaged_meshes);
  for (TreeRecord& record : records) {
    const TreeId id = record.id;
    by_age_.insert({record.created_ms, id});
    Entry& entry = entries_[id];
    entry.record = std::move(record);
    if (entry.record.tree || entry.record.resumed >= rules_.max_resumes) continue;
    StartTask(&entry, TreeTask::Kind::kResume, MemoryCharge());
  }
}

void TreeRegistry::Shutdown() {
  const std::lock_guard lock(mutex_);
  is_shut_down_ = true;
  store_until_ = now_() + rules_.time_to_store;
  for (auto& [id, entry] : entries_) {
    if (!entry.task) continue;
    entry.task->watch.cancel.Cancel();
    EndTask(&entry, std::nullopt, ShuttingDown());
  }
}

bool TreeRegistry::is_shut_down() const {
  const std::lock_guard lock(mutex_);
  return is_shut_down_;
}

Result<TreeRegistry::Entry*> TreeRegistry::Find(const TreeId& id) {
  if (const auto found = entries_.find(id); found != entries_.end()) return &found->second;
  if (const auto failed = failures_.find(id); failed != failures_.end()) {
    if (now_() < failed->second.until) return failed->second.error;
    failures_.erase(failed);
  }
  return NoSuchTree();
}

Status TreeRegistry::Check(const TreeId& id) {
  const std::lock_guard lock(mutex_);
  const Result<Entry*> entry = Find(id);
  return entry.ok() ? Status() : Status(entry.error());
}

TreeInfo TreeRegistry::InfoOf(const Entry& entry) {
  TreeInfo info;
  info.record = entry.record;
  info.progress = info.ready() ? 1.0 : entry.task ? entry.task->watch.fraction() : 0.0;
  return info;
}

Result<TreeInfo> TreeRegistry::Info(const TreeId& id) {
  const std::lock_guard lock(mutex_);
  const Result<Entry*> entry = Find(id);
  if (!entry.ok()) return entry.error();
  return InfoOf(**entry);
}

Result<std::optional<BuildKind>> TreeRegistry::ReadyBuild(const TreeId& id) {
  const std::lock_guard lock(mutex_);
  const Result<Entry*> entry = Find(id);
  if (!entry.ok()) return entry.error();
  const std::optional<TreeFacts>& tree = (*entry)->record.tree;
  return tree ? std::optional<BuildKind>(tree->build) : std::nullopt;
}

std::vector<TreeInfo> TreeRegistry::List(const std::optional<Sha256Digest>& mesh,
                                         const std::optional<TreePosition>& after,
                                         std::size_t limit) const {
  const std::lock_guard lock(mutex_);
  std::vector<TreeInfo> trees;
  auto next = after ? by_age_.upper_bound(*after) : by_age_.begin();
  for (; next != by_age_.end() && trees.size() < limit; ++next) {
    if (mesh && next->id.mesh != *mesh) continue;
    trees.push_back(InfoOf(entries_.at(next->id)));
  }
  return trees;
}

TreeRegistry::Counts TreeRegistry::counts() const {
  const std::lock_guard lock(mutex_);
  return {entries_.size(), damaged_meshes_.size(), rebuilds_};
}

Result<std::shared_ptr<TreeTask>> TreeRegistry::Ask(const TreeId& id, Need need) {
  const std::lock_guard lock(mutex_);
  const Result<Entry*> found = Find(id);
  if (!found.ok()) return found.error();
  Entry* entry = *found;
  if (need == Need::kReady && entry->record.tree) return std::shared_ptr<TreeTask>();
  if (!entry->task) {
    if (entry->failure) {
      if (now_() < entry->failure->until) return entry->failure->error;
      entry->failure.reset();
    }
    if (is_shut_down_) return ShuttingDown();
    StartTask(entry, entry->record.tree ? TreeTask::Kind::kLoad : TreeTask::Kind::kBuild,
              MemoryCharge());
  }
  entry->task->is_asked_for_ = true;
  return entry->task;
}

// Hands the task over first: a task without a worker would be waited for for ever. The worker's
// first event waits for mutex_.
void TreeRegistry::StartTask(Entry* entry, TreeTask::Kind kind, MemoryCharge admission) {
  if (is_shut_down_) return;
  auto task = std::make_shared<TreeTask>(entry->record.id, kind, std::move(admission));
  start_(task);
  entry->task = std::move(task);
}

void TreeRegistry::EndTask(Entry* entry, std::optional<Scene> scene,
                           std::optional<Error> error) noexcept {
  entry->task->admission_ = MemoryCharge();
  entry->task->End(std::move(scene), std::move(error));
  entry->task.reset();
}

TreeRegistry::Entry* TreeRegistry::EntryOf(const TreeTask& task) {
  const auto found = entries_.find(task.id);
  return found != entries_.end() && found->second.task.get() == &task ? &found->second : nullptr;
}

const TreeRegistry::Entry* TreeRegistry::EntryOf(const TreeTask& task) const {
  const auto found = entries_.find(task.id);
  return found != entries_.end() && found->second.task.get() == &task ? &found->second : nullptr;
}

// Meshes.

TreeRegistry::Entries::const_iterator TreeRegistry::FirstOf(const Sha256Digest& mesh) const {
  // An id without a build sorts before those with one.
  const auto first = entries_.lower_bound(TreeId{mesh, std::nullopt});
  return first != entries_.end() && first->first.mesh == mesh ? first : entries_.end();
}

bool TreeRegistry::HasMesh(const Sha256Digest& mesh) const {
  const std::lock_guard lock(mutex_);
  return FirstOf(mesh) != entries_.end();
}

bool TreeRegistry::HasSoundMesh(const Sha256Digest& mesh) const {
  const std::lock_guard lock(mutex_);
  return FirstOf(mesh) != entries_.end() && !damaged_meshes_.contains(mesh);
}

std::optional<TreeRegistry::MeshInfo> TreeRegistry::FindMesh(const Sha256Digest& mesh) const {
  const std::lock_guard lock(mutex_);
  const auto first = FirstOf(mesh);
  if (first == entries_.end()) return std::nullopt;
  return MeshInfo{first->second.record.mesh_bytes, first->second.record.mesh};
}

void TreeRegistry::NoteMeshStored(const Sha256Digest& mesh, std::uint64_t bytes) {
  const std::lock_guard lock(mutex_);
  damaged_meshes_.erase(mesh);
  for (auto entry = entries_.lower_bound(TreeId{mesh, std::nullopt});
       entry != entries_.end() && entry->first.mesh == mesh; ++entry) {
    entry->second.record.mesh_bytes = bytes;
  }
}

bool TreeRegistry::NoteMeshDamaged(const Sha256Digest& mesh) {
  const std::lock_guard lock(mutex_);
  if (FirstOf(mesh) == entries_.end()) return false;
  damaged_meshes_.insert(mesh);
  return true;
}

TreeRegistry::Wanted TreeRegistry::WantedOf(const Sha256Digest& mesh) const {
  const std::lock_guard lock(mutex_);
  Wanted wanted;
  ForEachOf(mesh, [&](const Entry& entry) {
    wanted.mesh = true;
    if (const auto build = BuildOf(entry.record))
      wanted.builds[static_cast<std::size_t>(*build)] = true;
  });
  return wanted;
}

bool TreeRegistry::MayStore(const Sha256Digest& mesh, BuildKind build) const {
  const std::lock_guard lock(mutex_);
  if (is_shut_down_ && now_() > store_until_) return false;
  bool is_wanted = false;
  ForEachOf(mesh,
            [&](const Entry& entry) { is_wanted = is_wanted || BuildOf(entry.record) == build; });
  return is_wanted;
}

std::set<Sha256Digest> TreeRegistry::MeshesUnderWay() const {
  const std::lock_guard lock(mutex_);
  std::set<Sha256Digest> meshes;
  for (const auto& [id, entry] : entries_) {
    if (entry.task) meshes.insert(id.mesh);
  }
  return meshes;
}

std::vector<TreeRecord> TreeRegistry::RecordsOf(const Sha256Digest& mesh) const {
  const std::lock_guard lock(mutex_);
  std::vector<TreeRecord> records;
  ForEachOf(mesh, [&](const Entry& entry) { records.push_back(entry.record); });
  return records;
}

std::optional<std::vector<TreeId>> TreeRegistry::IdleTreesOf(const Sha256Digest& mesh) const {
  const std::lock_guard lock(mutex_);
  std::vector<TreeId> ids;
  bool is_idle = true;
  ForEachOf(mesh, [&](const Entry& entry) {
    ids.push_back(entry.record.id);
    is_idle = is_idle && !entry.task;
  });
  if (!is_idle) return std::nullopt;
  return ids;
}

std::optional<BuildKind> TreeRegistry::BuildOf(const TreeRecord& record) {
  if (record.id.build) return record.id.build;
  if (record.tree) return record.tree->build;
  if (record.mesh && NeedsNoTree(static_cast<std::size_t>(record.mesh->triangles))) {
    return BuildKind::kBox;
  }
  return std::nullopt;
}

// Adding.

bool TreeRegistry::IsReadyOrUnderWay(const TreeId& id) const {
  const std::lock_guard lock(mutex_);
  const auto found = entries_.find(id);
  return found != entries_.end() && (found->second.record.tree || found->second.task);
}

bool TreeRegistry::IsAnyUnderWay() const {
  const std::lock_guard lock(mutex_);
  return std::any_of(entries_.begin(), entries_.end(),
                     [](const auto& entry) { return entry.second.task != nullptr; });
}

std::optional<TreeRegistry::Recorded> TreeRegistry::FindRecord(const TreeId& id) const {
  const std::lock_guard lock(mutex_);
  const auto found = entries_.find(id);
  if (found == entries_.end()) return std::nullopt;
  return Recorded{found->second.record, found->second.is_in_doubt};
}

TreeRegistry::NewTree::NewTree(const TreeRecord& record) {
  place_.insert({record.created_ms, record.id});
  Entry& entry = entry_[record.id];
  entry.is_new = true;
  entry.record = record;
}

void TreeRegistry::Add(NewTree tree, MemoryCharge admission) {
  const std::lock_guard lock(mutex_);
  failures_.erase(tree.entry_.begin()->first);
  by_age_.insert(tree.place_.extract(tree.place_.begin()));
  Entry& entry = entries_.insert(tree.entry_.extract(tree.entry_.begin())).position->second;
  StartTask(&entry, TreeTask::Kind::kBuild, std::move(admission));
  if (entry.task) entry.task->is_asked_for_ = true;
}

void TreeRegistry::AddKnown(NewTree tree) {
  const std::lock_guard lock(mutex_);
  failures_.erase(tree.entry_.begin()->first);
  by_age_.insert(tree.place_.extract(tree.place_.begin()));
  Entry& entry = entries_.insert(tree.entry_.extract(tree.entry_.begin())).position->second;
  entry.is_new = false;
}

void TreeRegistry::AddAgain(const TreeId& id, MemoryCharge admission) {
  const std::lock_guard lock(mutex_);
  Entry& entry = entries_.at(id);
  entry.is_in_doubt = false;
  entry.failure.reset();  // a new request tries again
  if (!entry.record.tree && !entry.task) {
    StartTask(&entry, TreeTask::Kind::kBuild, std::move(admission));
  }
  if (entry.task) entry.task->is_asked_for_ = true;
}

void TreeRegistry::ClearDoubt(const TreeId& id) {
  const std::lock_guard lock(mutex_);
  if (const auto found = entries_.find(id); found != entries_.end()) {
    found->second.is_in_doubt = false;
  }
}

// Removing.

bool TreeRegistry::ForgetFailure(const TreeId& id) {
  const std::lock_guard lock(mutex_);
  return failures_.erase(id) != 0;
}

std::optional<TreeRecord> TreeRegistry::BeginRemoval(const TreeId& id) {
  const std::lock_guard lock(mutex_);
  const auto found = entries_.find(id);
  if (found == entries_.end()) return std::nullopt;
  std::optional<TreeRecord> record = found->second.record;
  found->second.is_in_doubt = true;
  return record;
}

void TreeRegistry::EndRemoval(const TreeId& id, bool is_in_doubt) {
  const std::lock_guard lock(mutex_);
  entries_.at(id).is_in_doubt = is_in_doubt;
}

std::optional<TreeRegistry::Removed> TreeRegistry::Remove(const TreeId& id, Error error) noexcept {
  const std::lock_guard lock(mutex_);
  const auto entry = entries_.find(id);
  if (entry == entries_.end()) return std::nullopt;
  const std::optional<BuildKind> build = BuildOf(entry->second.record);
  if (entry->second.task) {
    entry->second.task->watch.cancel.Cancel();
    EndTask(&entry->second, std::nullopt, std::move(error));
  }
  by_age_.erase({entry->second.record.created_ms, id});
  entries_.erase(entry);
  Removed removed;
  removed.mesh_too = FirstOf(id.mesh) == entries_.end();
  if (removed.mesh_too) damaged_meshes_.erase(id.mesh);
  removed.build = build;
  ForEachOf(id.mesh, [&](const Entry& other) {
    if (BuildOf(other.record) == build) removed.build.reset();
  });
  return removed;
}

}  // namespace kdray::core
