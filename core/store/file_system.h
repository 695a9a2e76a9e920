// SPDX-License-Identifier: Apache-2.0
// An interface of the file operations that the store needs, so a test can make each of them fail.
// core/store/blob_store.h puts crash-safe files on top.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/base/result.h"

namespace kdray::core {

/// A new file that is being written. The destructor closes it; written bytes stay.
class WritableFile {
 public:
  virtual ~WritableFile() = default;
  /// Appends all of `bytes`; after an error any part of them may be written.
  virtual Status Append(std::span<const std::byte> bytes) = 0;
  /// Returns when the contents are on stable storage. After an error do not try again, but write
  /// another file.
  virtual Status Sync() = 0;
};

/// What the system says of a file's content without reading it: equal versions have equal contents,
/// unless the disk fails.
struct FileVersion {
  std::uint64_t device = 0, inode = 0, bytes = 0;
  std::int64_t modified_ns = 0, changed_ns = 0;  ///< since 1970
  friend bool operator==(const FileVersion&, const FileVersion&) = default;
};

/// An existing regular file. Readable while held, even if its name is removed meanwhile. Safe from
/// many threads at once. Plain reads, never mapped memory: if the file is truncated, a read is
/// short, instead of SIGBUS.
class ReadableFile {
 public:
  virtual ~ReadableFile() = default;
  /// The size when it was opened.
  virtual std::uint64_t size() const = 0;
  /// The version when it was opened; nullopt if the file system has none.
  virtual std::optional<FileVersion> version() const { return std::nullopt; }
  /// Fills all of `out` from `offset`; kCorrupt if the file ends earlier.
  virtual Status ReadAt(std::uint64_t offset, std::span<std::byte> out) const = 0;
};

struct FileInfo {
  std::string name;
  std::uint64_t bytes = 0;
  std::int64_t modified_ms = 0;  ///< since 1970, UTC
  bool readable = true;          ///< Open would accept it: a regular file of this user
};

/// User ids of a folder's owner and of this process.
struct FolderInfo {
  std::uint32_t owner = 0;
  std::uint32_t user = 0;
};

/// Held until destroyed, or until the process ends.
class FileLock {
 public:
  virtual ~FileLock() = default;
};

/// Errors of every operation: kNotFound (no such file), kStoreFull (no room, quota, file size limit
/// or a read-only file system), kCorrupt (the name is not a regular file of this user: a link, a
/// folder, another owner), kIo (everything else). Messages name no paths. Safe from many threads at
/// once.
class FileSystem {
 public:
  using Path = std::filesystem::path;
  virtual ~FileSystem() = default;

  /// A new file that only this user may read; kIo if the name exists.
  virtual Result<std::unique_ptr<WritableFile>> Create(const Path& path) = 0;
  /// Does not follow a link in the last component.
  virtual Result<std::unique_ptr<ReadableFile>> Open(const Path& path) = 0;
  /// Replaces `to`. Durable after SyncDirectory.
  virtual Status Rename(const Path& from, const Path& to) = 0;
  virtual Status Remove(const Path& path) = 0;
  virtual Status SyncDirectory(const Path& path) = 0;
  /// Follows links. kNotFound if nothing is there, or a link to nothing; kCorrupt if it is not a
  /// folder.
  virtual Result<FolderInfo> Examine(const Path& directory) = 0;
  /// Makes it with its parents, for this user only; success if it exists. Follows links.
  virtual Status MakeDirectory(const Path& path) = 0;
  /// Everything except "." and "..", in no order.
  virtual Result<std::vector<FileInfo>> List(const Path& directory) = 0;
  /// Sets the modification time to now.
  virtual Status Touch(const Path& path) = 0;
  /// Room that this user can still fill.
  virtual Result<std::uint64_t> FreeBytes(const Path& directory) = 0;
  /// Makes the file if it does not exist; kInvalidArgument if another process holds the lock.
  virtual Result<std::unique_ptr<FileLock>> Lock(const Path& path) = 0;
};

/// The operating system's files; one for the whole process.
FileSystem& PosixFileSystem();

}  // namespace kdray::core
