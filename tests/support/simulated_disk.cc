// SPDX-License-Identifier: Apache-2.0
#include "tests/support/simulated_disk.h"

#include <algorithm>
#include <utility>

namespace kdray::test {

using core::Error;
using core::ErrorCode;
using core::Result;
using core::Status;

class SimulatedDisk::File final : public core::WritableFile {
 public:
  File(SimulatedDisk* disk, std::shared_ptr<Inode> inode)
      : disk_(disk), inode_(std::move(inode)), life_(disk->life_) {}

  Status Append(std::span<const std::byte> bytes) override {
    const std::lock_guard lock(disk_->mutex_);
    std::optional<Error> fault = disk_->WriteStep();
    if (life_ != disk_->life_) return Error{ErrorCode::kIo, "the process that wrote is gone"};
    std::size_t fits = bytes.size();
    if (fault) fits /= 2;
    if (disk_->capacity_) {
      const std::uint64_t used = disk_->Used();
      const std::uint64_t room = *disk_->capacity_ > used ? *disk_->capacity_ - used : 0;
      fits = std::min<std::size_t>(fits, static_cast<std::size_t>(room));
    }
    inode_->contents.insert(inode_->contents.end(), bytes.begin(),
                            bytes.begin() + static_cast<std::ptrdiff_t>(fits));
    if (fault) return *std::move(fault);
    if (fits < bytes.size()) return Error{ErrorCode::kStoreFull, "the disk is full"};
    return {};
  }
  Status Sync() override {
    const std::lock_guard lock(disk_->mutex_);
    if (std::optional<Error> fault = disk_->WriteStep()) return *std::move(fault);
    inode_->synced = inode_->contents;
    return {};
  }

 private:
  SimulatedDisk* disk_;
  std::shared_ptr<Inode> inode_;
  std::uint64_t life_;
};

class SimulatedDisk::Reader final : public core::ReadableFile {
 public:
  Reader(SimulatedDisk* disk, std::shared_ptr<Inode> inode)
      : disk_(disk), inode_(std::move(inode)), size_(inode_->contents.size()) {}

  std::uint64_t size() const override { return size_; }
  Status ReadAt(std::uint64_t offset, std::span<std::byte> out) const override {
    const std::lock_guard lock(disk_->mutex_);
    if (std::optional<Error> fault = disk_->Step()) return *std::move(fault);
    const std::vector<std::byte>& contents = inode_->contents;
    if (offset > contents.size() || out.size() > contents.size() - offset) {
      return Error{ErrorCode::kCorrupt, "short file"};
    }
    std::copy_n(contents.begin() + static_cast<std::ptrdiff_t>(offset), out.size(), out.begin());
    return {};
  }

 private:
  SimulatedDisk* disk_;
  std::shared_ptr<Inode> inode_;
  std::uint64_t size_;
};

class SimulatedDisk::HeldLock final : public core::FileLock {
 public:
  HeldLock(SimulatedDisk* disk, Path path)
      : disk_(disk), path_(std::move(path)), life_(disk->life_) {}
  ~HeldLock() override {
    const std::lock_guard lock(disk_->mutex_);
    if (life_ == disk_->life_) disk_->locked_[path_] = false;
  }

 private:
  SimulatedDisk* disk_;
  Path path_;
  std::uint64_t life_;
};

void SimulatedDisk::FailAt(std::uint64_t n, ErrorCode code) {
  const std::lock_guard lock(mutex_);
  operations_ = 0;
  fail_at_ = n;
  fail_code_ = code;
  die_at_.reset();
}

void SimulatedDisk::DieAt(std::uint64_t n) {
  const std::lock_guard lock(mutex_);
  operations_ = 0;
  die_at_ = n;
  fail_at_.reset();
}

void SimulatedDisk::Revive() {
  const std::lock_guard lock(mutex_);
  fail_at_.reset();
  die_at_.reset();
}

void SimulatedDisk::Restart(Loss loss) {
  const std::lock_guard lock(mutex_);
  operations_ = 0;
  fail_at_.reset();
  die_at_.reset();
  locked_.clear();
  ++life_;
  for (auto& [path, folder] : folders_) {
    if (loss == Loss::kEverything) folder.names = folder.synced;
    for (auto& [name, inode] : folder.names) {
      if (loss == Loss::kNothing) continue;
      if (inode->synced) {
        inode->contents = *inode->synced;
      } else {
        inode->contents.resize(inode->contents.size() / 2);
      }
    }
    folder.synced = folder.names;
  }
}

std::uint64_t SimulatedDisk::operations() const {
  const std::lock_guard lock(mutex_);
  return operations_;
}

void SimulatedDisk::set_capacity(std::optional<std::uint64_t> bytes) {
  const std::lock_guard lock(mutex_);
  capacity_ = bytes;
}

void SimulatedDisk::set_read_only(bool read_only) {
  const std::lock_guard lock(mutex_);
  read_only_ = read_only;
}

std::vector<std::string> SimulatedDisk::FilesIn(const Path& directory) const {
  const std::lock_guard lock(mutex_);
  std::vector<std::string> names;
  if (const auto folder = folders_.find(Resolve(directory)); folder != folders_.end()) {
    for (const auto& [name, inode] : folder->second.names) names.push_back(name);
  }
  return names;
}

std::optional<std::vector<std::byte>> SimulatedDisk::Contents(const Path& path) const {
  const std::lock_guard lock(mutex_);
  const auto folder = folders_.find(Resolve(path.parent_path()));
  if (folder == folders_.end()) return std::nullopt;
  const auto file = folder->second.names.find(path.filename());
  if (file == folder->second.names.end()) return std::nullopt;
  return file->second->contents;
}

void SimulatedDisk::SetContents(const Path& path, std::vector<std::byte> contents) {
  const std::lock_guard lock(mutex_);
  auto inode = std::make_shared<Inode>();
  inode->contents = contents;
  inode->synced = std::move(contents);
  inode->modified_ms = ++clock_ms_;
  Folder& folder = folders_[Resolve(path.parent_path())];
  folder.names[path.filename()] = inode;
  folder.synced[path.filename()] = inode;
}

void SimulatedDisk::Erase(const Path& path) {
  const std::lock_guard lock(mutex_);
  folders_[Resolve(path.parent_path())].names.erase(path.filename());
  folders_[Resolve(path.parent_path())].synced.erase(path.filename());
}

void SimulatedDisk::MakeUnreadable(const Path& path) {
  const std::lock_guard lock(mutex_);
  folders_[Resolve(path.parent_path())].names.at(path.filename())->readable = false;
}

void SimulatedDisk::MakeReadable(const Path& path) {
  const std::lock_guard lock(mutex_);
  folders_[Resolve(path.parent_path())].names.at(path.filename())->readable = true;
}

void SimulatedDisk::GiveAway(const Path& folder) {
  const std::lock_guard lock(mutex_);
  Folder& given = folders_.at(Resolve(folder));
  given.own = false;
  for (auto& [name, inode] : given.names) inode->readable = false;
}

void SimulatedDisk::TakeBack(const Path& folder) {
  const std::lock_guard lock(mutex_);
  Folder& taken = folders_.at(Resolve(folder));
  taken.own = true;
  for (auto& [name, inode] : taken.names) inode->readable = true;
}

void SimulatedDisk::Unmount(const Path& folder, Absence absence) {
  const std::lock_guard lock(mutex_);
  const Path path = Resolve(folder);
  unmounted_[path] = std::move(folders_.at(path));
  folders_.erase(path);
  if (absence == Absence::kEmpty) folders_[path];
}

void SimulatedDisk::Mount(const Path& folder) {
  const std::lock_guard lock(mutex_);
  const auto back = unmounted_.find(Resolve(folder));
  folders_[back->first] = std::move(back->second);
  unmounted_.erase(back);
}

void SimulatedDisk::SetAccess(const Path& folder, Access access) {
  const std::lock_guard lock(mutex_);
  folders_.at(Resolve(folder)).access = access;
}

void SimulatedDisk::Link(const Path& folder, const Path& target) {
  const std::lock_guard lock(mutex_);
  std::map<Path, Folder> moved;
  for (auto& [path, contents] : folders_) {
    const Path below = path.lexically_relative(folder);
    const bool is_below = !below.empty() && *below.begin() != "..";
    moved[!is_below ? path : below == "." ? target : target / below] = std::move(contents);
  }
  folders_ = std::move(moved);
  links_[folder] = target;
}

std::map<core::FileSystem::Path, std::vector<std::byte>> SimulatedDisk::AllFiles() const {
  const std::lock_guard lock(mutex_);
  std::map<Path, std::vector<std::byte>> files;
  for (const auto& [path, folder] : folders_) {
    for (const auto& [name, inode] : folder.names) files[path / name] = inode->contents;
  }
  return files;
}

std::optional<Error> SimulatedDisk::Step() {
  const std::uint64_t number = operations_++;
  if (die_at_ && number >= *die_at_) return Error{ErrorCode::kIo, "the process has died"};
  if (fail_at_ && number == *fail_at_) return Error{fail_code_, "a fault was asked for"};
  return std::nullopt;
}

std::optional<Error> SimulatedDisk::WriteStep() {
  if (std::optional<Error> fault = Step()) return fault;
  if (read_only_) return Error{ErrorCode::kStoreFull, "the disk is read-only"};
  return std::nullopt;
}

core::FileSystem::Path SimulatedDisk::Resolve(const Path& folder) const {
  Path resolved;
  for (const Path& part : folder) {
    resolved /= part;
    if (const auto link = links_.find(resolved); link != links_.end()) resolved = link->second;
  }
  return resolved;
}

SimulatedDisk::Folder* SimulatedDisk::Find(const Path& folder) {
  const auto found = folders_.find(Resolve(folder));
  return found == folders_.end() ? nullptr : &found->second;
}

std::optional<Error> SimulatedDisk::Refuses(const Folder* folder, bool to_write) const {
  if (folder == nullptr) return Error{ErrorCode::kNotFound, "no such folder"};
  const bool allowed =
      to_write ? folder->access == Access::kAll : folder->access != Access::kNothing;
  if (!allowed) return Error{ErrorCode::kIo, "permission denied"};
  return std::nullopt;
}

std::uint64_t SimulatedDisk::Used() const {
  std::uint64_t used = 0;
  for (const auto& [path, folder] : folders_) {
    for (const auto& [name, inode] : folder.names) used += inode->contents.size();
  }
  return used;
}

Result<std::unique_ptr<core::WritableFile>> SimulatedDisk::Create(const Path& path) {
  const std::lock_guard lock(mutex_);
  if (std::optional<Error> fault = WriteStep()) return *std::move(fault);
  Folder* folder = FolderOf(path);
  if (std::optional<Error> refusal = Refuses(folder, true)) return *std::move(refusal);
  auto inode = std::make_shared<Inode>();
  inode->modified_ms = ++clock_ms_;
  if (!folder->names.emplace(path.filename(), inode).second) {
    return Error{ErrorCode::kIo, "the name is taken"};
  }
  return std::unique_ptr<core::WritableFile>(std::make_unique<File>(this, std::move(inode)));
}

Result<std::unique_ptr<core::ReadableFile>> SimulatedDisk::Open(const Path& path) {
  const std::lock_guard lock(mutex_);
  if (std::optional<Error> fault = Step()) return *std::move(fault);
  Folder* folder = FolderOf(path);
  if (std::optional<Error> refusal = Refuses(folder, false)) return *std::move(refusal);
  const auto file = folder->names.find(path.filename());
  if (file == folder->names.end()) return Error{ErrorCode::kNotFound, "no such file"};
  if (!file->second->readable) return Error{ErrorCode::kCorrupt, "no regular file"};
  return std::unique_ptr<core::ReadableFile>(std::make_unique<Reader>(this, file->second));
}

Status SimulatedDisk::Rename(const Path& from, const Path& to) {
  const std::lock_guard lock(mutex_);
  if (std::optional<Error> fault = WriteStep()) return *std::move(fault);
  Folder* source = FolderOf(from);
  Folder* target = FolderOf(to);
  for (const Folder* folder : {source, target}) {
    if (std::optional<Error> refusal = Refuses(folder, true)) return *std::move(refusal);
  }
  const auto file = source->names.find(from.filename());
  if (file == source->names.end()) return Error{ErrorCode::kNotFound, "no such file"};
  const std::shared_ptr<Inode> inode = file->second;
  source->names.erase(file);
  target->names[to.filename()] = inode;
  return {};
}

Status SimulatedDisk::Remove(const Path& path) {
  const std::lock_guard lock(mutex_);
  if (std::optional<Error> fault = WriteStep()) return *std::move(fault);
  Folder* folder = FolderOf(path);
  if (std::optional<Error> refusal = Refuses(folder, true)) return *std::move(refusal);
  if (folder->names.erase(path.filename()) == 0) {
    return Error{ErrorCode::kNotFound, "no such file"};
  }
  return {};
}

Status SimulatedDisk::SyncDirectory(const Path& path) {
  const std::lock_guard lock(mutex_);
  if (std::optional<Error> fault = WriteStep()) return *std::move(fault);
  Folder* folder = Find(path);
  if (std::optional<Error> refusal = Refuses(folder, false)) return *std::move(refusal);
  folder->synced = folder->names;
  return {};
}

Result<core::FolderInfo> SimulatedDisk::Examine(const Path& directory) {
  const std::lock_guard lock(mutex_);
  if (std::optional<Error> fault = Step()) return *std::move(fault);
  const Folder* folder = Find(directory);
  if (folder == nullptr) return Error{ErrorCode::kNotFound, "no such folder"};
  constexpr std::uint32_t kUser = 1000;
  return core::FolderInfo{folder->own ? kUser : kUser + 1, kUser};
}

Status SimulatedDisk::MakeDirectory(const Path& path) {
  const std::lock_guard lock(mutex_);
  if (std::optional<Error> fault = Step()) return *std::move(fault);
  if (Find(path) != nullptr) return {};
  if (links_.contains(path)) return Error{ErrorCode::kIo, "no folder"};
  if (read_only_) return Error{ErrorCode::kStoreFull, "the disk is read-only"};
  folders_[Resolve(path)];
  return {};
}

Result<std::vector<core::FileInfo>> SimulatedDisk::List(const Path& directory) {
  const std::lock_guard lock(mutex_);
  if (std::optional<Error> fault = Step()) return *std::move(fault);
  const Folder* folder = Find(directory);
  if (std::optional<Error> refusal = Refuses(folder, false)) return *std::move(refusal);
  std::vector<core::FileInfo> files;
  for (const auto& [name, inode] : folder->names) {
    files.push_back({name, inode->contents.size(), inode->modified_ms, inode->readable});
  }
  return files;
}

Status SimulatedDisk::Touch(const Path& path) {
  const std::lock_guard lock(mutex_);
  if (std::optional<Error> fault = WriteStep()) return *std::move(fault);
  Folder* folder = FolderOf(path);
  if (std::optional<Error> refusal = Refuses(folder, false)) return *std::move(refusal);
  const auto file = folder->names.find(path.filename());
  if (file == folder->names.end()) return Error{ErrorCode::kNotFound, "no such file"};
  file->second->modified_ms = ++clock_ms_;
  return {};
}

Result<std::uint64_t> SimulatedDisk::FreeBytes(const Path&) {
  const std::lock_guard lock(mutex_);
  if (std::optional<Error> fault = Step()) return *std::move(fault);
  const std::uint64_t used = Used();
  if (!capacity_) return std::uint64_t{1} << 50;
  return *capacity_ > used ? *capacity_ - used : 0;
}

Result<std::unique_ptr<core::FileLock>> SimulatedDisk::Lock(const Path& path) {
  const std::lock_guard lock(mutex_);
  if (std::optional<Error> fault = Step()) return *std::move(fault);
  if (locked_[path]) return Error{ErrorCode::kInvalidArgument, "another process has it"};
  locked_[path] = true;
  return std::unique_ptr<core::FileLock>(std::make_unique<HeldLock>(this, path));
}

}  // namespace kdray::test
