// SPDX-License-Identifier: Apache-2.0
// The files of meshes and trees that are fetched from the shared store.
#include <chrono>
#include <new>
#include <utility>

#include "core/library/shared_trees.h"

namespace kdray::core {
namespace {

// Poll interval; a CancelToken has no notification.
constexpr std::chrono::milliseconds kLookAgain{50};

Error NoSuchTree() { return Error{ErrorCode::kNotFound, "no tree has this id"}; }
Error NoMemory() {
  return Error{ErrorCode::kMemoryFull, "there is no memory for a transfer from the store now"};
}

}  // namespace

// One fetch of a mesh at a time.
class SharedTrees::FetchTurn {
 public:
  static std::optional<FetchTurn> Wait(SharedTrees* owner, const Sha256Digest& mesh,
                                       const CancelToken& cancel) {
    std::unique_lock lock(owner->mutex_);
    while (owner->fetching_.contains(mesh)) {
      if (cancel.ShouldStop() || owner->stop_.ShouldStop()) return std::nullopt;
      owner->changed_.wait_for(lock, kLookAgain);
    }
    owner->fetching_.insert(mesh);
    return FetchTurn(owner, mesh);
  }
  FetchTurn(FetchTurn&& other) noexcept
      : owner_(std::exchange(other.owner_, nullptr)), mesh_(other.mesh_) {}
  FetchTurn& operator=(FetchTurn&&) = delete;
  ~FetchTurn() {
    if (owner_ == nullptr) return;
    const std::lock_guard lock(owner_->mutex_);
    owner_->fetching_.erase(mesh_);
    owner_->changed_.notify_all();
  }

 private:
  FetchTurn(SharedTrees* owner, const Sha256Digest& mesh) : owner_(owner), mesh_(mesh) {}
  SharedTrees* owner_;
  Sha256Digest mesh_;
};

void SharedTrees::Note(std::uint64_t FileCounts::*where, FileCounts Counts::*what) {
  const std::lock_guard lock(mutex_);
  ++(counts_.*what.*where);
}

Result<SharedTrees::Buffer> SharedTrees::MakeBuffer(std::uint64_t object_bytes) {
  const std::size_t bytes = SharedStore::BufferBytes(object_bytes);
  std::optional<MemoryCharge> charge = parts_.budget->TryReserve(bytes);
  if (!charge) return NoMemory();
  try {
    return Buffer{*std::move(charge), std::vector<std::byte>(bytes)};
  } catch (const std::bad_alloc&) {
    return NoMemory();
  }
}

Status SharedTrees::BringMesh(const Sha256Digest& mesh, const CancelToken& cancel) {
  const auto is_here = [&](std::uint64_t bytes) {
    return parts_.registry->HasSoundMesh(mesh) && parts_.store->HasMesh(mesh, bytes);
  };
  std::optional<TreeRegistry::MeshInfo> info = parts_.registry->FindMesh(mesh);
  if (!info) return NoSuchTree();
  if (is_here(info->bytes)) {
    Note(&FileCounts::here, &Counts::meshes);
    return {};
  }
  const std::optional<FetchTurn> turn = FetchTurn::Wait(this, mesh, cancel);
  if (!turn) return (cancel.ShouldStop() ? cancel : stop_).ToError();
  info = parts_.registry->FindMesh(mesh);
  if (!info) return NoSuchTree();
  if (is_here(info->bytes)) return {};  // another request has fetched it
  return FetchMesh(mesh, info->bytes, cancel);
}

Status SharedTrees::FetchMesh(const Sha256Digest& mesh, std::uint64_t bytes,
                              const CancelToken& cancel) {
  Result<Buffer> buffer = MakeBuffer(bytes);
  if (!buffer.ok()) return std::move(buffer).error();
  const Result<std::vector<std::string>> copies = shared_.CopiesOf(mesh, bytes, cancel);
  if (!copies.ok()) return Unanswered(copies.error());
  Status status = Error{ErrorCode::kCorrupt, "the store has no sound copy of the mesh"};
  // Twice, because bytes may change on their way.
  for (int attempt = 0; attempt < 2; ++attempt) {
    for (const std::string& copy : *copies) {
      Result<NewMesh> file = parts_.store->BeginMesh(bytes);
      if (!file.ok()) return std::move(file).error();
      const Status read = shared_.Read(
          copy, bytes, buffer->bytes,
          [&](std::span<const std::byte> piece) { return file->Append(piece); }, cancel);
      if (!read.ok() && read.error().code != ErrorCode::kCorrupt &&
          read.error().code != ErrorCode::kNotFound) {
        return read;
      }
      if (read.ok() && file->Digest() == mesh) return PlaceMesh(mesh, *std::move(file));
    }
  }
  return status;
}

Status SharedTrees::PlaceMesh(const Sha256Digest& mesh, NewMesh file) {
  const std::uint64_t bytes = file.bytes();
  Result<DiskRoom> room = parts_.make_room(bytes);
  if (!room.ok()) return std::move(room).error();
  if (Status status = file.Sync(); !status.ok()) return status;
  const std::lock_guard files_lock(parts_.mesh_locks->Of(mesh));
  const std::vector<TreeRecord> records = parts_.registry->RecordsOf(mesh);
  if (records.empty()) return NoSuchTree();
  if (Status status = parts_.store->Commit(mesh, std::move(file), *std::move(room)); !status.ok()) {
    return status;
  }
  parts_.registry->NoteMeshStored(mesh, bytes);
  // After a start without the store, the trees are known.
  for (const TreeRecord& record : records) (void)parts_.store->SaveRecord(record);
  Note(&FileCounts::fetched, &Counts::meshes);
  return {};
}

Status SharedTrees::BringFiles(const TreeRecord& record, const CancelToken& cancel) {
  if (Status status = BringMesh(record.id.mesh, cancel); !status.ok()) return status;
  const std::optional<BuildKind> build = TreeRegistry::BuildOf(record);
  if (build) BringTree(record.id.mesh, *build, cancel);
  return {};
}

// Whatever goes wrong, the tree can be built.
void SharedTrees::BringTree(const Sha256Digest& mesh, BuildKind build, const CancelToken& cancel) {
  if (parts_.store->TreeFileBytes(mesh, build) != 0) {
    Note(&FileCounts::here, &Counts::trees);
    return;
  }
  if (objects_.IsAway()) return;
  if (parts_.cache->FindTree(mesh, build) != nullptr) return;
  const Result<std::uint64_t> bytes = shared_.TreeBytes(mesh, build, cancel);
  if (!bytes.ok()) return;
  Result<Buffer> buffer = MakeBuffer(*bytes);
  if (!buffer.ok()) return;
  bool is_fetched = false;
  const Status stored = parts_.store->StoreTree(mesh, build, *bytes, [&](NewBlob* blob) {
    const Status read = shared_.ReadTree(
        mesh, build, *bytes, buffer->bytes,
        [&](std::span<const std::byte> piece) { return blob->Append(piece); }, cancel);
    is_fetched = read.ok();
    return read;
  });
  if (!stored.ok() || !is_fetched) return;
  Note(&FileCounts::fetched, &Counts::trees);
}

}  // namespace kdray::core
