// SPDX-License-Identifier: Apache-2.0
// A disk in memory that can fail at any operation, fill up, become read-only, and lose what was not
// synced: the state after a crash or a power failure, without one.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/store/file_system.h"

namespace kdray::test {

/// Safe from many threads at once. Folders are durable at once; names in them after SyncDirectory,
/// contents of files after Sync.
class SimulatedDisk final : public core::FileSystem {
 public:
  /// The loss of unsynced data in a power failure.
  enum class Loss {
    kNothing,     ///< only the process ended
    kContents,    ///< names had reached the disk, contents had not: files are truncated to half
    kEverything,  ///< neither had
  };

  /// Operation number `n` from now (0: the next) fails once; a write leaves half of its bytes.
  void FailAt(std::uint64_t n, core::ErrorCode code);
  /// Operation number `n` from now and all after it fail: the process has died.
  void DieAt(std::uint64_t n);
  /// No more faults: the disk recovers while the process continues.
  void Revive();
  /// Restarts after a crash: no more faults, and locks are free.
  void Restart(Loss loss);
  /// Operations since the last FailAt, DieAt or Restart.
  std::uint64_t operations() const;

  void set_capacity(std::optional<std::uint64_t> bytes);
  void set_read_only(bool read_only);

  // Changes without the store's knowledge. Paths as the store names them.
  std::vector<std::string> FilesIn(const Path& directory) const;
  std::optional<std::vector<std::byte>> Contents(const Path& path) const;
  void SetContents(const Path& path, std::vector<std::byte> contents);
  void Erase(const Path& path);
  /// From now on the name is not a regular file of this user: a link, or another user's file.
  void MakeUnreadable(const Path& path);
  void MakeReadable(const Path& path);

  // Changes of folders by administrators.
  /// The folder and all in it belong to another user from now on, as after chown -R by root.
  void GiveAway(const Path& folder);
  void TakeBack(const Path& folder);
  /// The folder is missing with its content, or empty like a mount point without its disk.
  enum class Absence { kMissing, kEmpty };
  void Unmount(const Path& folder, Absence absence);
  void Mount(const Path& folder);
  /// This user's access to the folder, as after chmod.
  enum class Access { kAll, kReadOnly, kNothing };
  void SetAccess(const Path& folder, Access access);
  /// Replaces the folder by a link to `target`, which need not exist, and moves the folder there.
  void Link(const Path& folder, const Path& target);
  /// Every file on the disk by its path, with its contents.
  std::map<Path, std::vector<std::byte>> AllFiles() const;

  core::Result<std::unique_ptr<core::WritableFile>> Create(const Path& path) override;
  core::Result<std::unique_ptr<core::ReadableFile>> Open(const Path& path) override;
  core::Status Rename(const Path& from, const Path& to) override;
  core::Status Remove(const Path& path) override;
  core::Status SyncDirectory(const Path& path) override;
  core::Result<core::FolderInfo> Examine(const Path& directory) override;
  core::Status MakeDirectory(const Path& path) override;
  core::Result<std::vector<core::FileInfo>> List(const Path& directory) override;
  core::Status Touch(const Path& path) override;
  core::Result<std::uint64_t> FreeBytes(const Path& directory) override;
  core::Result<std::unique_ptr<core::FileLock>> Lock(const Path& path) override;

 private:
  struct Inode {
    std::vector<std::byte> contents;
    std::optional<std::vector<std::byte>> synced;
    std::int64_t modified_ms = 0;
    bool readable = true;
  };
  struct Folder {
    std::map<std::string, std::shared_ptr<Inode>> names;
    std::map<std::string, std::shared_ptr<Inode>> synced;
    bool own = true;
    Access access = Access::kAll;
  };
  class File;
  class Reader;
  class HeldLock;

  // With mutex_ held:
  std::optional<core::Error> Step();       // counts an operation; returns the fault that is due
  std::optional<core::Error> WriteStep();  // as Step, for operations that change something
  Path Resolve(const Path& folder) const;  // the path after all links
  Folder* Find(const Path& folder);
  Folder* FolderOf(const Path& path) { return Find(path.parent_path()); }
  std::optional<core::Error> Refuses(const Folder* folder, bool to_write) const;
  std::uint64_t Used() const;

  mutable std::mutex mutex_;
  std::map<Path, Folder> folders_;
  std::map<Path, Folder> unmounted_;
  std::map<Path, Path> links_;
  std::map<Path, bool> locked_;
  std::uint64_t operations_ = 0;
  std::optional<std::uint64_t> fail_at_;
  std::optional<std::uint64_t> die_at_;
  core::ErrorCode fail_code_ = core::ErrorCode::kIo;
  std::optional<std::uint64_t> capacity_;
  bool read_only_ = false;
  std::int64_t clock_ms_ = 1'600'000'000'000;
  std::uint64_t life_ = 0;  // files opened before a restart are invalid
};

}  // namespace kdray::test
