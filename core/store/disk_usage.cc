// SPDX-License-Identifier: Apache-2.0
#include "core/store/disk_usage.h"

namespace kdray::core {

DiskRoom::~DiskRoom() {
  if (usage_ == nullptr) return;
  const std::lock_guard lock(usage_->mutex_);
  usage_->reserved_ -= bytes_;
}

ArrivingRoom::~ArrivingRoom() {
  if (usage_ == nullptr) return;
  const std::lock_guard lock(usage_->mutex_);
  usage_->arriving_ -= bytes_;
}

bool ArrivingRoom::Grow(std::uint64_t bytes) {
  const std::lock_guard lock(usage_->mutex_);
  if (!usage_->Fits(bytes, usage_->arriving_)) return false;
  usage_->arriving_ += bytes;
  bytes_ += bytes;
  return true;
}

void DiskUsage::Erase(Group* group, std::list<File>::iterator file) {
  group->bytes -= file->bytes;
  group->index.erase(group->index.find(file->name));
  group->files.erase(file);
}

DiskUsage::Note::Note(std::string_view name, std::uint64_t bytes) {
  file_.push_front({std::string(name), bytes});
  index_.emplace(name, file_.begin());
}

void DiskUsage::Set(FileGroup group, Note note) noexcept {
  const std::lock_guard lock(mutex_);
  Group& g = At(group);
  const File& file = note.file_.front();
  if (const auto found = g.index.find(file.name); found != g.index.end()) Erase(&g, found->second);
  g.bytes += file.bytes;
  g.files.splice(g.files.begin(), note.file_);
  g.index.insert(note.index_.extract(note.index_.begin()));
}

void DiskUsage::Move(FileGroup from, FileGroup to, std::string_view name) noexcept {
  const std::lock_guard lock(mutex_);
  Group& source = At(from);
  Group& target = At(to);
  const auto found = source.index.find(name);
  if (found == source.index.end()) return;
  if (const auto old = target.index.find(name); old != target.index.end()) {
    Erase(&target, old->second);
  }
  source.bytes -= found->second->bytes;
  target.bytes += found->second->bytes;
  target.files.splice(target.files.begin(), source.files, found->second);
  target.index.insert(source.index.extract(found));
}

bool DiskUsage::Drop(FileGroup group, std::string_view name) {
  const std::lock_guard lock(mutex_);
  Group& g = At(group);
  const auto found = g.index.find(name);
  if (found == g.index.end()) return false;
  Erase(&g, found->second);
  return true;
}

void DiskUsage::Use(FileGroup group, std::string_view name) {
  const std::lock_guard lock(mutex_);
  Group& g = At(group);
  const auto found = g.index.find(name);
  if (found != g.index.end()) g.files.splice(g.files.begin(), g.files, found->second);
}

std::optional<DiskRoom> DiskUsage::TryReserve(std::uint64_t bytes) {
  const std::lock_guard lock(mutex_);
  if (!Fits(bytes, TotalLocked() + reserved_)) return std::nullopt;
  reserved_ += bytes;
  return DiskRoom(this, bytes);
}

bool DiskUsage::IsWithinLimit() const {
  const std::lock_guard lock(mutex_);
  // Meshes without a record are evicted first, so they do not count here: no derived file is
  // evicted for their room.
  return Fits(arriving_, TotalLocked() - At(FileGroup::kUnrecorded).bytes + reserved_);
}

bool DiskUsage::FitsBesideMeshes(std::uint64_t bytes) const {
  const std::lock_guard lock(mutex_);
  const std::uint64_t meshes = At(FileGroup::kMeshes).bytes + At(FileGroup::kUnrecorded).bytes;
  return Fits(bytes, meshes + reserved_);
}

std::optional<std::string> DiskUsage::Oldest(FileGroup group,
                                             const std::set<std::string>& except) const {
  const std::lock_guard lock(mutex_);
  const std::list<File>& files = At(group).files;
  for (auto file = files.rbegin(); file != files.rend(); ++file) {
    if (!except.contains(file->name)) return file->name;
  }
  return std::nullopt;
}

std::uint64_t DiskUsage::BytesOf(FileGroup group, std::string_view name) const {
  const std::lock_guard lock(mutex_);
  const Group& g = At(group);
  const auto found = g.index.find(name);
  return found == g.index.end() ? 0 : found->second->bytes;
}

std::uint64_t DiskUsage::Count(FileGroup group) const {
  const std::lock_guard lock(mutex_);
  return At(group).files.size();
}

std::uint64_t DiskUsage::TotalLocked() const {
  std::uint64_t total = 0;
  for (const Group& group : groups_) total += group.bytes;
  return total;
}

std::uint64_t DiskUsage::derived() const {
  const std::lock_guard lock(mutex_);
  return TotalLocked() - At(FileGroup::kMeshes).bytes - At(FileGroup::kUnrecorded).bytes;
}

std::uint64_t DiskUsage::total() const {
  const std::lock_guard lock(mutex_);
  return TotalLocked();
}

}  // namespace kdray::core
