// SPDX-License-Identifier: Apache-2.0
// The attributes of meshes (core/io/mesh_attributes.h) are read from the stored files when they
// are first needed: once for all that ask, in memory that is reserved.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>

#include "core/base/cancel.h"
#include "core/base/hash.h"
#include "core/base/result.h"
#include "core/io/mesh_attributes.h"
#include "core/library/memory_budget.h"
#include "core/library/tree_cache.h"
#include "core/library/work_queue.h"
#include "core/store/scene_store.h"

namespace kdray::core {

/// Safe from many threads at once.
class AttributeLoader {
 public:
  struct Parts {
    SceneStore* store;
    TreeCache* cache;
    MemoryBudget* budget;
    /// Called when attributes were put into the cache: their mesh may have been deleted meanwhile.
    std::function<void(const Sha256Digest&)> evict_unwanted;
  };
  /// All must outlive this.
  explicit AttributeLoader(Parts parts);
  ~AttributeLoader();  ///< as Stop

  /// The attributes of a stored mesh, of these kinds at least: from the cache, or read from the
  /// mesh's file together with the kinds that the cache has already. All who ask for one mesh at
  /// the same time share one reading, which belongs to none of them: it ends early only when all of
  /// them have left.
  ///
  /// A request does not wait for memory here, because the caller holds a tree that others may wait
  /// for. Errors: kMemoryFull when the memory is not free now; kMeshTooLarge if it could never be;
  /// kCorrupt if the stored file is damaged; those of ReadAttributes; kDeadlineExceeded and
  /// kCancelled by `cancel`, and kCancelled after Stop. `file_bytes`: the size of the mesh's file.
  Result<TreeCache::AttributesPointer> Load(const Sha256Digest& mesh, std::uint64_t file_bytes,
                                            AttributeKinds kinds, const CancelToken& cancel);

  /// Stops what is under way and tells all who wait. Load reads nothing after it.
  void Stop();

  /// Mesh files that were read for their attributes.
  std::uint64_t reads() const { return reads_; }

 private:
  struct Reading;
  using Readings = std::map<Sha256Digest, std::shared_ptr<Reading>>;

  void Run(const std::shared_ptr<Reading>& reading) noexcept;
  Result<TreeCache::AttributesPointer> Read(const Reading& reading);
  // With mutex_ held:
  std::shared_ptr<Reading> Begin(const Sha256Digest& mesh, std::uint64_t file_bytes,
                                 AttributeKinds kinds);
  void End(Reading* reading, Result<TreeCache::AttributesPointer> result) noexcept;

  const Parts parts_;
  std::atomic<std::uint64_t> reads_{0};
  std::mutex mutex_;
  Readings under_way_;
  bool stopped_ = false;
  WorkQueue queue_;  // last: its threads use all of the above
};

}  // namespace kdray::core
