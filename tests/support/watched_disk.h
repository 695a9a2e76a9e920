// SPDX-License-Identifier: Apache-2.0
// A file system that tells a test of every piece that is read or written, before it happens: so a
// test can do something in the middle of a file.
#pragma once

#include <functional>
#include <memory>
#include <utility>
#include <vector>

#include "core/store/file_system.h"

namespace kdray::test {

/// Passes everything on to another file system. Set the functions before others use it.
class WatchedDisk final : public core::FileSystem {
 public:
  explicit WatchedDisk(core::FileSystem* disk) : disk_(*disk) {}

  /// Called with the number of bytes.
  std::function<void(std::size_t)> on_read = [](std::size_t) {};
  std::function<void(std::size_t)> on_write = [](std::size_t) {};

  core::Result<std::unique_ptr<core::WritableFile>> Create(const Path& path) override {
    auto file = disk_.Create(path);
    if (!file.ok()) return file;
    return std::unique_ptr<core::WritableFile>(std::make_unique<Writer>(this, *std::move(file)));
  }
  core::Result<std::unique_ptr<core::ReadableFile>> Open(const Path& path) override {
    auto file = disk_.Open(path);
    if (!file.ok()) return file;
    return std::unique_ptr<core::ReadableFile>(std::make_unique<Reader>(this, *std::move(file)));
  }
  core::Status Rename(const Path& from, const Path& to) override { return disk_.Rename(from, to); }
  core::Status Remove(const Path& path) override { return disk_.Remove(path); }
  core::Status SyncDirectory(const Path& path) override { return disk_.SyncDirectory(path); }
  core::Result<core::FolderInfo> Examine(const Path& directory) override {
    return disk_.Examine(directory);
  }
  core::Status MakeDirectory(const Path& path) override { return disk_.MakeDirectory(path); }
  core::Result<std::vector<core::FileInfo>> List(const Path& directory) override {
    return disk_.List(directory);
  }
  core::Status Touch(const Path& path) override { return disk_.Touch(path); }
  core::Result<std::uint64_t> FreeBytes(const Path& directory) override {
    return disk_.FreeBytes(directory);
  }
  core::Result<std::unique_ptr<core::FileLock>> Lock(const Path& path) override {
    return disk_.Lock(path);
  }

 private:
  class Writer final : public core::WritableFile {
   public:
    Writer(const WatchedDisk* disk, std::unique_ptr<core::WritableFile> file)
        : disk_(*disk), file_(std::move(file)) {}
    core::Status Append(std::span<const std::byte> bytes) override {
      disk_.on_write(bytes.size());
      return file_->Append(bytes);
    }
    core::Status Sync() override { return file_->Sync(); }

   private:
    const WatchedDisk& disk_;
    std::unique_ptr<core::WritableFile> file_;
  };
  class Reader final : public core::ReadableFile {
   public:
    Reader(const WatchedDisk* disk, std::unique_ptr<core::ReadableFile> file)
        : disk_(*disk), file_(std::move(file)) {}
    std::uint64_t size() const override { return file_->size(); }
    std::optional<core::FileVersion> version() const override { return file_->version(); }
    core::Status ReadAt(std::uint64_t offset, std::span<std::byte> out) const override {
      disk_.on_read(out.size());
      return file_->ReadAt(offset, out);
    }

   private:
    const WatchedDisk& disk_;
    std::unique_ptr<core::ReadableFile> file_;
  };

  core::FileSystem& disk_;
};

}  // namespace kdray::test
