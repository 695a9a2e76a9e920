// SPDX-License-Identifier: Apache-2.0
#include "core/library/tree_remover.h"

#include <utility>

#include "core/store/try_to_remove.h"

namespace kdray::core {

Status TreeRemover::Remove(const TreeId& id, Error error) {
  // The record first: after a crash only a mesh without a record remains. Later steps cannot fail.
  if (Status status = RemoveRecord(id); !status.ok()) return status;
  RemoveTree(id, std::move(error));
  return {};
}

Status TreeRemover::RemoveRecord(const TreeId& id) {
  const std::optional<TreeRecord> record = registry_->BeginRemoval(id);
  if (!record) return Error{ErrorCode::kNotFound, "no tree has this id"};
  Status removed = store_->RemoveRecord(id);
  if (removed.ok()) return removed;
  registry_->EndRemoval(id, !store_->SaveRecord(*record).ok());
  return removed;
}

void TreeRemover::RemoveTree(const TreeId& id, Error error) noexcept {
  const std::optional<TreeRegistry::Removed> removed = registry_->Remove(id, std::move(error));
  if (!removed) return;
  if (removed->mesh_too) {
    measurements_->Forget(id.mesh);
    cache_->EraseMesh(id.mesh);
  } else if (removed->build) {
    cache_->EraseTree(id.mesh, *removed->build);
  }
  if (removed->mesh_too) {
    TryRemoveMeshIfUnused(id.mesh);
  } else if (removed->build) {
    TryToRemove([&] { store_->RemoveTree(id.mesh, *removed->build); });
  }
}

// Records that a failed write may have left are removed before the file, so no start finds a record
// without its mesh.
Status TreeRemover::RemoveMeshIfUnused(const Sha256Digest& mesh) {
  if (registry_->HasMesh(mesh)) return {};
  if (Status status = store_->RemoveRecordsOf(mesh); !status.ok()) {
    store_->MarkUnrecorded(mesh);
    return status;
  }
  return store_->RemoveMesh(mesh);
}

void TreeRemover::TryRemoveMeshIfUnused(const Sha256Digest& mesh) noexcept {
  TryToRemove([&] { (void)RemoveMeshIfUnused(mesh); });
}

void TreeRemover::EvictUnwanted(const Sha256Digest& mesh) noexcept {
  const TreeRegistry::Wanted wanted = registry_->WantedOf(mesh);
  if (!wanted.mesh) cache_->EraseMesh(mesh);
  for (const BuildKind build : kAllBuildKinds) {
    if (!wanted.Has(build)) cache_->EraseTree(mesh, build);
  }
}

}  // namespace kdray::core
