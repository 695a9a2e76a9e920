// SPDX-License-Identifier: Apache-2.0
// Uploads, from the first byte of a mesh to the record of its tree.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <utility>

#include "core/base/hash.h"
#include "core/base/result.h"
#include "core/catalog/tree_id.h"
#include "core/library/memory_budget.h"
#include "core/library/mesh_locks.h"
#include "core/library/shared_trees.h"
#include "core/library/tree_registry.h"
#include "core/library/tree_remover.h"
#include "core/store/scene_store.h"

namespace kdray::core {

class MeshIntake;

/// An unfinished upload; the destructor removes it. For one thread at a time. The library must
/// outlive it.
class MeshUpload {
 public:
  /// kMeshTooLarge if such a mesh exceeds a limit; kStoreFull; kIo.
  Status Append(std::span<const std::byte> bytes);

 private:
  friend class MeshIntake;
  MeshUpload(const MeshIntake* intake, std::uint64_t checked_bytes, NewMesh file)
      : intake_(intake), checked_bytes_(checked_bytes), file_(std::move(file)) {}

  const MeshIntake* intake_;
  std::uint64_t checked_bytes_;  ///< a mesh of this size exceeds no limit
  NewMesh file_;
};

/// Safe from many threads at once.
class MeshIntake {
 public:
  /// All must outlive this.
  struct Parts {
    TreeRegistry* registry;
    TreeRemover* remover;
    SceneStore* store;
    MeshLocks* mesh_locks;
    const MemoryBudget* budget;
    SharedTrees* shared;  ///< null without a shared store
  };
  explicit MeshIntake(const Parts& parts)
      : parts_(parts), admitted_builds_(parts.budget->limit()) {}

  // As in TreeLibrary:
  struct Added {
    TreeId id;
    bool existed = false;
  };
  Result<MeshUpload> BeginUpload(std::uint64_t bytes);
  Result<Added> Finish(MeshUpload upload, std::optional<BuildKind> build);
  Result<Added> AddBuild(const Sha256Digest& mesh, std::optional<BuildKind> build);

  /// Room for a mesh: evicts meshes without a record first, then derived files, then whole meshes
  /// without running work. Not to be called with a lock.
  Result<DiskRoom> MakeRoom(std::uint64_t bytes);

 private:
  // `shared`: the tree's record in the shared store; null without one.
  Result<Added> Place(const TreeId& id, MeshUpload upload, const TreeRecord* shared);
  Result<Added> AddStored(const TreeId& id, const TreeRecord* shared);
  template <class PlaceIt>
  Result<Added> PublishAndPlace(const TreeId& id, const ReadableFile& mesh, const PlaceIt& place);
  Status DropMesh(const Sha256Digest& mesh);
  Status DropUnrecordedMesh(const Sha256Digest& mesh);
  bool IsStored(const Sha256Digest& mesh, std::uint64_t bytes) const;
  friend class MeshUpload;
  Status CheckCouldFit(std::uint64_t bytes) const;
  Error TooLargeForStore(std::uint64_t bytes) const;
  std::uint64_t UsualParseBytes(std::uint64_t mesh_bytes) const;
  Result<MemoryCharge> Admit(const TreeId& id, std::uint64_t mesh_bytes);
  // The caller holds the mesh's lock, and its bytes are on disk:
  Result<Added> Add(const TreeId& id, std::uint64_t mesh_bytes, const TreeRecord* shared,
                    MemoryCharge admission);
  Result<Added> AddAgain(const TreeId& id, const TreeRegistry::Recorded& recorded,
                         MemoryCharge admission);
  void GiveUpAdding(const TreeId& id) noexcept;

  const Parts parts_;
  // The memory that running builds usually need. It limits the uploads that are accepted and holds
  // no memory itself; builds reserve what they use in the library's budget.
  MemoryBudget admitted_builds_;
};

}  // namespace kdray::core
