// SPDX-License-Identifier: Apache-2.0
// Takes trees away: their records, their files, and what is in memory of them.
#pragma once

#include <optional>

#include "core/base/hash.h"
#include "core/base/result.h"
#include "core/catalog/tree_id.h"
#include "core/library/measurements.h"
#include "core/library/tree_cache.h"
#include "core/library/tree_registry.h"
#include "core/store/scene_store.h"

namespace kdray::core {

/// The caller holds the mesh's lock (MeshLocks) in every call. Safe from many threads at once.
class TreeRemover {
 public:
  /// All must outlive this.
  TreeRemover(TreeRegistry* registry, SceneStore* store, TreeCache* cache,
              Measurements* measurements)
      : registry_(registry), store_(store), cache_(cache), measurements_(measurements) {}

  /// The tree is durably removed when this returns; the mesh is removed with its last tree. `error`
  /// is given to those who wait for the tree. kNotFound for an absent id; errors of RemoveRecord.
  Status Remove(const TreeId& id, Error error);

  /// The first half of Remove. After an error of the disk the tree still exists. Its record may be
  /// missing, but not durably: it is written again, now or when the id is added again.
  Status RemoveRecord(const TreeId& id);
  /// The second half, after RemoveRecord. The tree is removed in any case; files that the disk does
  /// not remove stay, as after a crash.
  void RemoveTree(const TreeId& id, Error error) noexcept;

  /// Removes the file of a mesh without trees, and the files derived from it: its last tree was
  /// removed, or an upload failed before its record.
  Status RemoveMeshIfUnused(const Sha256Digest& mesh);
  /// The same, where the error cannot be reported.
  void TryRemoveMeshIfUnused(const Sha256Digest& mesh) noexcept;

  /// Erases from memory the mesh and trees that no id needs any more.
  void EvictUnwanted(const Sha256Digest& mesh) noexcept;

 private:
  TreeRegistry* registry_;
  SceneStore* store_;
  TreeCache* cache_;
  Measurements* measurements_;
};

}  // namespace kdray::core
