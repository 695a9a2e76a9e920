// SPDX-License-Identifier: Apache-2.0
#include "core/library/mesh_intake.h"

#include <algorithm>
#include <chrono>
#include <set>
#include <string>
#include <vector>

#include "core/library/parse_mesh.h"
#include "core/store/try_to_remove.h"

namespace kdray::core {
namespace {

std::int64_t NowMs() {
  return std::chrono::duration_cast<std::chrono::milliseconds>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

Error NoSuchTree() { return Error{ErrorCode::kNotFound, "no tree has this id"}; }
Error NoSuchMesh() { return Error{ErrorCode::kNotFound, "no mesh has this SHA-256"}; }
Error NoMemoryForBuilds() {
  return Error{ErrorCode::kMemoryFull, "the builds under way need all memory"};
}

}  // namespace

Result<MeshUpload> MeshIntake::BeginUpload(std::uint64_t bytes) {
  if (parts_.shared != nullptr) {
    if (Status status = parts_.shared->CheckThere(); !status.ok()) return std::move(status).error();
  }
  if (Status status = CheckCouldFit(bytes); !status.ok()) return std::move(status).error();
  if (!admitted_builds_.TryReserve(UsualParseBytes(bytes))) return NoMemoryForBuilds();
  Result<NewMesh> file = parts_.store->BeginMesh(bytes);
  if (!file.ok()) return std::move(file).error();
  return MeshUpload(this, bytes, *std::move(file));
}

// An upload may have more bytes than were declared, if its size was not known.
Status MeshUpload::Append(std::span<const std::byte> bytes) {
  const std::uint64_t total = file_.bytes() + bytes.size();
  if (total > checked_bytes_) {
    if (Status status = intake_->CheckCouldFit(total); !status.ok()) return status;
    checked_bytes_ = total;
  }
  return file_.Append(bytes);
}

Status MeshIntake::CheckCouldFit(std::uint64_t bytes) const {
  if (parts_.store->limit() && bytes > *parts_.store->limit()) return TooLargeForStore(bytes);
  return parts_.budget->CheckCouldFit(LeastParseBytes(bytes));
}

Error MeshIntake::TooLargeForStore(std::uint64_t bytes) const {
  return Error{ErrorCode::kMeshTooLarge, "a mesh of " + std::to_string(bytes) +
                                             " bytes is larger than the store, which takes " +
                                             std::to_string(*parts_.store->limit())};
}

Result<DiskRoom> MeshIntake::MakeRoom(std::uint64_t bytes) {
  SceneStore* const store = parts_.store;
  if (store->limit() && bytes > *store->limit()) return TooLargeForStore(bytes);
  for (;;) {
    if (std::optional<DiskRoom> room = store->TryReserve(bytes)) return *std::move(room);
    if (const std::optional<Sha256Digest> unrecorded = store->OldestUnrecordedMesh()) {
      if (Status status = DropUnrecordedMesh(*unrecorded); !status.ok()) {
        return std::move(status).error();
      }
      continue;
    }
    if (std::optional<DiskRoom> room = store->MakeRoom(bytes)) return *std::move(room);
    std::set<std::string> busy;
    for (const Sha256Digest& mesh : parts_.registry->MeshesUnderWay()) busy.insert(mesh.ToHex());
    const std::optional<Sha256Digest> victim = store->OldestMesh(busy);
    if (!victim) return Error{ErrorCode::kStoreFull, "the store has no room for this mesh now"};
    if (Status status = DropMesh(*victim); !status.ok()) return std::move(status).error();
  }
}

// Drops a mesh with all its trees, unless work on it has begun meanwhile.
Status MeshIntake::DropMesh(const Sha256Digest& mesh) {
  const std::lock_guard files_lock(parts_.mesh_locks->Of(mesh));
  const std::optional<std::vector<TreeId>> ids = parts_.registry->IdleTreesOf(mesh);
  if (!ids) return {};
  for (const TreeId& id : *ids) {
    if (Status status = parts_.remover->Remove(id, NoSuchTree()); !status.ok()) return status;
  }
  // Called again for its status: a mesh that cannot be removed must not be retried for ever.
  return parts_.remover->RemoveMeshIfUnused(mesh);
}

Status MeshIntake::DropUnrecordedMesh(const Sha256Digest& mesh) {
  const std::lock_guard files_lock(parts_.mesh_locks->Of(mesh));
  return parts_.remover->RemoveMeshIfUnused(mesh);
}

bool MeshIntake::IsStored(const Sha256Digest& mesh, std::uint64_t bytes) const {
  return parts_.registry->HasSoundMesh(mesh) && parts_.store->HasMesh(mesh, bytes);
}

// A mesh that needs more is still accepted alone.
std::uint64_t MeshIntake::UsualParseBytes(std::uint64_t mesh_bytes) const {
  return std::min(EstimateParseBytes(mesh_bytes), admitted_builds_.limit());
}

// No admission for a tree that is ready or has a running task.
Result<MemoryCharge> MeshIntake::Admit(const TreeId& id, std::uint64_t mesh_bytes) {
  if (parts_.registry->IsReadyOrUnderWay(id)) return MemoryCharge();
  std::optional<MemoryCharge> admission = admitted_builds_.TryReserve(UsualParseBytes(mesh_bytes));
  if (!admission) return NoMemoryForBuilds();
  return *std::move(admission);
}

Result<MeshIntake::Added> MeshIntake::Finish(MeshUpload upload, std::optional<BuildKind> build) {
  const std::uint64_t bytes = upload.file_.bytes();
  if (bytes == 0) return Error{ErrorCode::kEmptyMesh, "the mesh has no bytes"};
  const TreeId id{upload.file_.Digest(), build};
  // Before anything is evicted for it. It may still fail later.
  if (Result<MemoryCharge> admission = Admit(id, bytes); !admission.ok()) {
    return std::move(admission).error();
  }
  if (parts_.shared == nullptr) return Place(id, std::move(upload), nullptr);
  const Result<std::unique_ptr<ReadableFile>> mesh = upload.file_.Reopen();
  if (!mesh.ok()) return mesh.error();
  return PublishAndPlace(
      id, **mesh, [&](const TreeRecord& record) { return Place(id, std::move(upload), &record); });
}

// What is acknowledged is in the shared store.
template <class PlaceIt>
Result<MeshIntake::Added> MeshIntake::PublishAndPlace(const TreeId& id, const ReadableFile& mesh,
                                                      const PlaceIt& place) {
  const Result<SharedStore::Published> published = parts_.shared->Publish(id, mesh);
  if (!published.ok()) return published.error();
  Result<Added> added = place(published->record);
  if (added.ok()) {
    added->existed = published->existed;
    parts_.shared->Confirm(id, published->seen);
  }
  return added;
}

Result<MeshIntake::Added> MeshIntake::Place(const TreeId& id, MeshUpload upload,
                                            const TreeRecord* shared) {
  const std::uint64_t bytes = upload.file_.bytes();
  std::optional<DiskRoom> room;
  for (;;) {
    // The slow part before the lock.
    if (!room && !IsStored(id.mesh, bytes)) {
      Result<DiskRoom> made = MakeRoom(bytes);
      if (!made.ok()) return std::move(made).error();
      room.emplace(*std::move(made));
      if (Status status = upload.file_.Sync(); !status.ok()) return std::move(status).error();
    }
    const std::lock_guard files_lock(parts_.mesh_locks->Of(id.mesh));
    const bool is_stored = IsStored(id.mesh, bytes);
    if (!is_stored && !room) continue;  // deleted meanwhile
    Result<MemoryCharge> admission = Admit(id, bytes);
    if (!admission.ok()) return std::move(admission).error();
    try {
      if (!is_stored) {
        Status status = parts_.store->Commit(id.mesh, std::move(upload.file_), *std::move(room));
        if (!status.ok()) {
          parts_.remover->TryRemoveMeshIfUnused(id.mesh);
          return std::move(status).error();
        }
        parts_.registry->NoteMeshStored(id.mesh, bytes);
      }
      return Add(id, bytes, shared, *std::move(admission));
    } catch (...) {
      parts_.remover->TryRemoveMeshIfUnused(id.mesh);
      throw;
    }
  }
}

Result<MeshIntake::Added> MeshIntake::AddBuild(const Sha256Digest& mesh,
                                               std::optional<BuildKind> build) {
  if (parts_.shared == nullptr) return AddStored({mesh, build}, nullptr);
  const CancelToken never;  // the upload of a mesh is not cancelled either
  Status status = parts_.shared->Meet(mesh, never);
  if (status.ok()) status = parts_.shared->BringMesh(mesh, never);
  if (!status.ok() && status.error().code == ErrorCode::kNotFound) return NoSuchMesh();
  if (!status.ok()) return std::move(status).error();
  const Result<std::unique_ptr<ReadableFile>> file = parts_.store->OpenMesh(mesh);
  if (!file.ok()) return file.error();
  const TreeId id{mesh, build};
  return PublishAndPlace(id, **file,
                         [&](const TreeRecord& record) { return AddStored(id, &record); });
}

Result<MeshIntake::Added> MeshIntake::AddStored(const TreeId& id, const TreeRecord* shared) {
  const std::lock_guard files_lock(parts_.mesh_locks->Of(id.mesh));
  const std::optional<TreeRegistry::MeshInfo> stored = parts_.registry->FindMesh(id.mesh);
  if (!stored) return NoSuchMesh();
  Result<MemoryCharge> admission = Admit(id, stored->bytes);
  if (!admission.ok()) return std::move(admission).error();
  return Add(id, stored->bytes, shared, *std::move(admission));
}

Result<MeshIntake::Added> MeshIntake::Add(const TreeId& id, std::uint64_t mesh_bytes,
                                          const TreeRecord* shared, MemoryCharge admission) {
  if (const auto recorded = parts_.registry->FindRecord(id)) {
    return AddAgain(id, *recorded, std::move(admission));
  }
  TreeRecord record;
  if (shared != nullptr) {
    record = *shared;
  } else {
    record.created_ms = NowMs();
  }
  record.id = id;
  record.mesh_bytes = mesh_bytes;
  if (!record.mesh) {
    if (const auto mesh = parts_.registry->FindMesh(id.mesh)) record.mesh = mesh->facts;
  }
  // Allocates everything before the record is written; later steps cannot fail.
  TreeRegistry::NewTree tree(record);
  try {
    if (Status status = parts_.store->SaveRecord(record); !status.ok()) {
      GiveUpAdding(id);
      return status.error();
    }
  } catch (...) {
    GiveUpAdding(id);
    throw;
  }
  if (record.tree) {
    parts_.registry->AddKnown(std::move(tree));
  } else {
    parts_.registry->Add(std::move(tree), std::move(admission));
  }
  return Added{id, false};
}

// After a record could not be written. Files that remain because of the disk, or for lack of
// memory, were not acknowledged; the next start finds them.
void MeshIntake::GiveUpAdding(const TreeId& id) noexcept {
  TryToRemove([&] { (void)parts_.store->RemoveRecord(id); });
  parts_.remover->TryRemoveMeshIfUnused(id.mesh);
}

// The answer guarantees a record on disk. A failed deletion, or another process, may have removed
// it.
Result<MeshIntake::Added> MeshIntake::AddAgain(const TreeId& id,
                                               const TreeRegistry::Recorded& recorded,
                                               MemoryCharge admission) {
  if (recorded.is_in_doubt || !parts_.store->HasRecord(id)) {
    if (Status status = parts_.store->SaveRecord(recorded.record); !status.ok()) {
      return std::move(status).error();
    }
  }
  parts_.registry->AddAgain(id, std::move(admission));
  return Added{id, true};
}

}  // namespace kdray::core
