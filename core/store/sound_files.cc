// SPDX-License-Identifier: Apache-2.0
#include "core/store/sound_files.h"

#include <cstdint>
#include <utility>

namespace kdray::core {

class SoundFiles::HashedFile final : public ReadableFile {
 public:
  HashedFile(SoundFiles* files, std::unique_ptr<ReadableFile> file, const Sha256Digest& mesh)
      : files_(*files), file_(std::move(file)), mesh_(mesh) {}

  std::uint64_t size() const override { return file_->size(); }
  Status ReadAt(std::uint64_t offset, std::span<std::byte> out) const override {
    if (Status status = file_->ReadAt(offset, out); !status.ok()) return status;
    if (offset != hashed_ || out.empty()) return {};
    hash_.Update(out);
    hashed_ += out.size();
    if (hashed_ != size() || hash_.Finish() == mesh_) return {};
    files_.Forget(mesh_);
    return Error{ErrorCode::kCorrupt, "a stored mesh has changed while it was read"};
  }

 private:
  SoundFiles& files_;
  std::unique_ptr<ReadableFile> file_;
  const Sha256Digest mesh_;
  // Reading is const; what has been read so far is not a part of the file.
  mutable Sha256 hash_;
  mutable std::uint64_t hashed_ = 0;
};

bool SoundFiles::Has(const Sha256Digest& mesh, const std::optional<FileVersion>& version) const {
  if (!version) return false;
  const std::lock_guard lock(mutex_);
  const auto found = versions_.find(mesh);
  return found != versions_.end() && found->second == *version;
}

void SoundFiles::Note(const Sha256Digest& mesh, const std::optional<FileVersion>& version) {
  if (!version) return;
  const std::lock_guard lock(mutex_);
  versions_[mesh] = *version;
}

void SoundFiles::Forget(const Sha256Digest& mesh) {
  const std::lock_guard lock(mutex_);
  versions_.erase(mesh);
}

std::unique_ptr<ReadableFile> SoundFiles::HashWhileRead(std::unique_ptr<ReadableFile> file,
                                                        const Sha256Digest& mesh) {
  return std::make_unique<HashedFile>(this, std::move(file), mesh);
}

}  // namespace kdray::core
