// SPDX-License-Identifier: Apache-2.0
#include "core/store/blob_store.h"

#include <unistd.h>

#include <atomic>
#include <chrono>
#include <utility>

#include "core/store/try_to_remove.h"

namespace kdray::core {
namespace {

constexpr std::string_view kTemporaryPrefix = ".new-";

// The clock keeps apart what an earlier process of the same number may have left on a disk that it
// could not be swept from.
std::string TemporaryName() {
  static std::atomic<std::int64_t> next{
      std::chrono::system_clock::now().time_since_epoch().count()};
  return std::string(kTemporaryPrefix) + std::to_string(getpid()) + "-" + std::to_string(next++);
}

// kNotFound during a write means the folder, not the file of that name.
Error WriteError(Error error) {
  if (error.code == ErrorCode::kNotFound) error.code = ErrorCode::kIo;
  return error;
}

Status WriteStatus(Status status) {
  if (status.ok()) return status;
  return WriteError(std::move(status).error());
}

}  // namespace

NewBlob::NewBlob(FileSystem* file_system, std::filesystem::path directory,
                 std::filesystem::path temporary)
    : file_system_(file_system),
      directory_(std::move(directory)),
      temporary_(std::move(temporary)) {}

NewBlob::NewBlob(NewBlob&& other) noexcept
    : file_system_(other.file_system_),
      directory_(std::move(other.directory_)),
      temporary_(std::move(other.temporary_)),
      file_(std::move(other.file_)),
      bytes_(other.bytes_),
      synced_(other.synced_) {
  other.temporary_.clear();
}

NewBlob::~NewBlob() {
  if (temporary_.empty()) return;
  // A failure leaves a file that the next Open sweeps.
  TryToRemove([&] { (void)file_system_->Remove(temporary_); });
}

Status NewBlob::Append(std::span<const std::byte> bytes) {
  synced_ = false;
  bytes_ += bytes.size();
  return file_->Append(bytes);
}

Status NewBlob::Sync() {
  if (Status status = file_->Sync(); !status.ok()) return status;
  synced_ = true;
  return {};
}

Status NewBlob::Commit(std::string_view name) {
  // Contents before name, name before the folder: a name never stands for contents that are not
  // there yet.
  if (!synced_) {
    if (Status status = Sync(); !status.ok()) return status;
  }
  if (Status status = file_system_->Rename(temporary_, directory_ / name); !status.ok()) {
    return WriteStatus(std::move(status));
  }
  temporary_.clear();
  file_.reset();
  return WriteStatus(file_system_->SyncDirectory(directory_));
}

BlobStore::BlobStore(FileSystem* file_system, std::filesystem::path directory)
    : file_system_(file_system), directory_(std::move(directory)) {}

Status BlobStore::Open() {
  if (Status status = file_system_->MakeDirectory(directory_); !status.ok()) return status;
  const Result<std::vector<FileInfo>> files = file_system_->List(directory_);
  if (!files.ok()) return files.error();
  for (const FileInfo& file : *files) {
    if (!file.name.starts_with(kTemporaryPrefix) || !file.readable) continue;
    // On a read-only disk they stay, which does no harm.
    (void)file_system_->Remove(directory_ / file.name);
  }
  return {};
}

Result<std::vector<FileInfo>> BlobStore::List() const {
  Result<std::vector<FileInfo>> files = file_system_->List(directory_);
  if (files.ok()) std::erase_if(*files, [](const FileInfo& f) { return f.name.starts_with('.'); });
  return files;
}

Result<NewBlob> BlobStore::Create() {
  // First who removes the file, then the file.
  NewBlob blob(file_system_, directory_, directory_ / TemporaryName());
  Result<std::unique_ptr<WritableFile>> file = file_system_->Create(blob.temporary_);
  if (!file.ok()) {
    blob.temporary_.clear();
    return WriteError(std::move(file).error());
  }
  blob.file_ = *std::move(file);
  return blob;
}

Result<std::unique_ptr<ReadableFile>> BlobStore::Read(std::string_view name) const {
  return file_system_->Open(directory_ / name);
}

Status BlobStore::Remove(std::span<const std::string_view> names) {
  for (const std::string_view name : names) {
    Status removed = file_system_->Remove(directory_ / name);
    if (!removed.ok() && removed.error().code != ErrorCode::kNotFound) return removed;
  }
  return WriteStatus(file_system_->SyncDirectory(directory_));
}

Status BlobStore::Touch(std::string_view name) { return file_system_->Touch(directory_ / name); }

}  // namespace kdray::core
