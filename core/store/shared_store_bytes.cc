// SPDX-License-Identifier: Apache-2.0
// How the bytes of meshes and trees get into the shared store, and out of it.
#include <algorithm>
#include <chrono>
#include <cstring>
#include <utility>

#include "core/store/shared_store.h"
#include "core/store/tree_file.h"

namespace kdray::core {
namespace {

constexpr std::chrono::milliseconds kTimeToAbort{150};

Error Corrupt(const char* what) {
  return Error{ErrorCode::kCorrupt, std::string("an object of the store ") + what};
}

}  // namespace

std::size_t SharedStore::BufferBytes(std::uint64_t object_bytes) {
  if (object_bytes <= kPieceBytes) return static_cast<std::size_t>(object_bytes);
  return static_cast<std::size_t>(
      std::max(kPieceBytes, object_bytes / ObjectStore::kMostParts + 1));
}

Result<std::vector<std::string>> SharedStore::CopiesOf(const Sha256Digest& mesh,
                                                       std::uint64_t bytes,
                                                       const CancelToken& cancel) {
  const Result<std::vector<ObjectInfo>> objects = ListAll("meshes/" + mesh.ToHex() + "/", cancel);
  if (!objects.ok()) return objects.error();
  std::vector<std::string> keys;
  for (const ObjectInfo& object : *objects) {
    if (object.bytes == bytes) keys.push_back(object.key);
  }
  return keys;
}

Status SharedStore::Read(std::string_view key, std::uint64_t bytes, std::span<std::byte> buffer,
                         const Append& append, const CancelToken& cancel) {
  for (std::uint64_t offset = 0; offset < bytes;) {
    const std::span<std::byte> piece = buffer.first(
        static_cast<std::size_t>(std::min<std::uint64_t>(buffer.size(), bytes - offset)));
    if (Status got = store_->Get(key, offset, piece, cancel); !got.ok()) return got;
    if (Status appended = append(piece); !appended.ok()) return appended;
    offset += piece.size();
  }
  return {};
}

std::string SharedStore::TreeKey(const Sha256Digest& mesh, BuildKind build) {
  return "trees/" + std::to_string(kBuilderRevision) + "/" + TreeId{mesh, build}.ToString();
}

Result<std::uint64_t> SharedStore::TreeBytes(const Sha256Digest& mesh, BuildKind build,
                                             const CancelToken& cancel) {
  const Result<ObjectInfo> object = store_->Head(TreeKey(mesh, build), cancel);
  if (!object.ok()) return object.error();
  return object->bytes;
}

// The last bytes of a checked file are the hash of all before.
Status SharedStore::ReadTree(const Sha256Digest& mesh, BuildKind build, std::uint64_t bytes,
                             std::span<std::byte> buffer, const Append& append,
                             const CancelToken& cancel) {
  Sha256Digest footer;
  constexpr std::uint64_t kFooter = sizeof(footer.bytes);
  Status status = Corrupt("is no tree");
  if (bytes > kFooter) {
    Sha256 hash;
    std::uint64_t left = bytes;
    const auto check = [&](std::span<const std::byte> piece) {
      const std::uint64_t after = left - piece.size();
      const std::uint64_t hashed = after >= kFooter ? piece.size()
                                   : left > kFooter ? left - kFooter
                                                    : 0;
      hash.Update(piece.first(static_cast<std::size_t>(hashed)));
      const auto rest = piece.subspan(static_cast<std::size_t>(hashed));
      if (!rest.empty()) {
        std::memcpy(footer.bytes.data() + (kFooter - left + hashed), rest.data(), rest.size());
      }
      left = after;
      return append(piece);
    };
    status = Read(TreeKey(mesh, build), bytes, buffer, check, cancel);
    if (status.ok() && hash.Finish() != footer) status = Corrupt("fails its check");
  }
  if (!status.ok() && status.error().code == ErrorCode::kCorrupt) {
    (void)store_->Delete(TreeKey(mesh, build), cancel);
  }
  return status;
}

Status SharedStore::PutTree(const Sha256Digest& mesh, BuildKind build, const ReadableFile& file,
                            std::span<std::byte> buffer, const CancelToken& cancel) {
  const std::string key = TreeKey(mesh, build);
  const Result<ObjectInfo> stored = store_->Head(key, cancel);
  if (stored.ok() && stored->bytes == file.size()) return {};
  if (!stored.ok() && stored.error().code != ErrorCode::kNotFound) return stored.error();
  // Another size comes from a write that the store cut off, or from another version of the format.
  return PutFile(key, file, buffer, stored.ok() ? PutMode::kReplace : PutMode::kKeep, cancel);
}

Status SharedStore::PutFile(const std::string& key, const ReadableFile& file,
                            std::span<std::byte> buffer, PutMode mode, const CancelToken& cancel) {
  if (file.size() <= buffer.size()) {
    const std::span<std::byte> all = buffer.first(static_cast<std::size_t>(file.size()));
    if (Status read = file.ReadAt(0, all); !read.ok()) return read;
    return store_->Put(key, all, mode, cancel);
  }
  const Result<std::string> upload = store_->BeginParts(key, cancel);
  if (!upload.ok()) return upload.error();
  Status status = PutParts(key, *upload, file, buffer, mode, cancel);
  if (!status.ok() && status.error().code == ErrorCode::kNotFound) {
    // A repeated FinishParts does not find the upload that its first attempt has finished.
    const Result<ObjectInfo> stored = store_->Head(key, cancel);
    if (stored.ok() && stored->bytes == file.size()) return {};
    if (!stored.ok()) return StoreIsAway("the store lost the parts of an object");
  }
  if (!status.ok()) {
    // A cancelled caller waits for little more.
    const bool is_cancelled = cancel.ShouldStop();
    (void)store_->AbortParts(
        key, *upload,
        is_cancelled ? CancelToken::WithDeadline(Clock::now() + kTimeToAbort) : cancel);
  }
  return status;
}

Status SharedStore::PutParts(const std::string& key, const std::string& upload,
                             const ReadableFile& file, std::span<std::byte> buffer, PutMode mode,
                             const CancelToken& cancel) {
  std::vector<std::string> tags;
  for (std::uint64_t offset = 0; offset < file.size();) {
    const std::span<std::byte> part = buffer.first(
        static_cast<std::size_t>(std::min<std::uint64_t>(buffer.size(), file.size() - offset)));
    if (Status read = file.ReadAt(offset, part); !read.ok()) return read;
    Result<std::string> tag =
        store_->PutPart(key, upload, static_cast<int>(tags.size()) + 1, part, cancel);
    if (!tag.ok()) return std::move(tag).error();
    tags.push_back(*std::move(tag));
    offset += part.size();
  }
  return store_->FinishParts(key, upload, tags, mode, cancel);
}

}  // namespace kdray::core
