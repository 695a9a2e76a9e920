// SPDX-License-Identifier: Apache-2.0
// One folder of immutable files with crash-safe writes: whatever happens, a name stands for a whole
// old file, a whole new one, or nothing. core/store/checked_file.h adds a check of the contents.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "core/base/result.h"
#include "core/store/file_system.h"

namespace kdray::core {

/// A file on its way into a BlobStore, under a temporary name in the same folder. Destroyed before
/// Commit, it is removed. One thread at a time.
class NewBlob {
 public:
  NewBlob(NewBlob&&) noexcept;
  NewBlob& operator=(NewBlob&&) = delete;
  ~NewBlob();

  Status Append(std::span<const std::byte> bytes);
  std::uint64_t bytes() const { return bytes_; }
  /// Puts the contents on stable storage; Commit does so itself when this was not called. Apart,
  /// so that a caller can do the slow part outside his locks.
  Status Sync();
  /// The bytes so far. Readable as long as this object lives, or its name stands for them.
  Result<std::unique_ptr<ReadableFile>> Reopen() const { return file_system_->Open(temporary_); }
  /// The file gets its name, replacing what had it, and is durable when this returns. After an
  /// error the name stands for the old file or the new one. Call once.
  Status Commit(std::string_view name);

 private:
  friend class BlobStore;
  NewBlob(FileSystem* file_system, std::filesystem::path directory,
          std::filesystem::path temporary);

  FileSystem* file_system_;
  std::filesystem::path directory_;
  std::filesystem::path temporary_;  // empty once committed or moved from
  std::unique_ptr<WritableFile> file_;
  std::uint64_t bytes_ = 0;
  bool synced_ = false;
};

/// Safe from many threads at once; two writers of one name both succeed, and one of their files
/// stays. Errors: those of FileSystem, except that writing to a folder that is gone is kIo.
class BlobStore {
 public:
  BlobStore(FileSystem* file_system, std::filesystem::path directory);

  /// Makes the folder if need be and removes temporary files that a crash left. Call before the
  /// first Create, while no other thread uses the folder.
  Status Open();
  /// Names are plain file names that do not begin with a dot.
  Result<std::vector<FileInfo>> List() const;
  Result<NewBlob> Create();
  Result<std::unique_ptr<ReadableFile>> Read(std::string_view name) const;
  /// Durable when it returns. A name that is not there is success.
  Status Remove(std::string_view name) { return Remove(std::span(&name, 1)); }
  /// All of them, at the price of one. After an error any of them may be there, or come back.
  Status Remove(std::span<const std::string_view> names);
  /// Notes that the file was used: its modification time becomes now.
  Status Touch(std::string_view name);

 private:
  FileSystem* file_system_;
  std::filesystem::path directory_;
};

}  // namespace kdray::core
