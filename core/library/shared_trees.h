// SPDX-License-Identifier: Apache-2.0
// The trees that a library shares with others through an object store (core/store/shared_store.h).
// The store decides which trees exist. The registry and the data directory are a cache of it:
// unknown ids are looked up, known ones confirmed at intervals, files are fetched when needed.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "core/base/cancel.h"
#include "core/base/hash.h"
#include "core/base/result.h"
#include "core/catalog/tree_id.h"
#include "core/library/memory_budget.h"
#include "core/library/mesh_locks.h"
#include "core/library/tree_cache.h"
#include "core/library/tree_registry.h"
#include "core/library/tree_remover.h"
#include "core/library/work_queue.h"
#include "core/store/counting_store.h"
#include "core/store/object_store.h"
#include "core/store/retrying_store.h"
#include "core/store/scene_store.h"
#include "core/store/shared_store.h"

namespace kdray::core {

struct SharedTreesOptions {
  ObjectStore* store = nullptr;  ///< outlives the library; null: no shared store
  std::string name;              ///< of the store, the same at each start: s3://bucket/prefix
  RetryingStore::Rule retries;
  /// A deletion by another library holds here after this time, while the store answers within a
  /// second.
  std::chrono::milliseconds confirm_every{10'000};
  RetryingStore::OnChange on_change;
};

/// Safe from many threads at once. No call holds a lock during a request to the store; none may be
/// called with a lock. Errors of every call: those of ObjectStore; kMemoryFull if there is no
/// memory for a buffer.
class SharedTrees {
 public:
  /// All must outlive this.
  struct Parts {
    TreeRegistry* registry;
    TreeRemover* remover;
    SceneStore* store;
    TreeCache* cache;
    MeshLocks* mesh_locks;
    MemoryBudget* budget;
    std::function<Result<DiskRoom>(std::uint64_t)> make_room;  ///< MeshIntake::MakeRoom
  };
  SharedTrees(const SharedTreesOptions& options, Parts parts);
  ~SharedTrees();  ///< as Stop

  /// An error if the store refuses to be read. A store that is away may come back.
  Status CheckAtStart();
  /// StoreIsAway if it was away just now.
  Status CheckThere() const;

  /// Call before a tree is used. After success the registry knows the tree, or knows why its build
  /// failed. kNotFound if no library has it; a tree that was deleted elsewhere is removed here. If
  /// the store does not answer: success for a known tree, else StoreIsAway.
  Status Ensure(const TreeId& id, const CancelToken& cancel);
  /// After success the registry knows a tree of the mesh. kNotFound.
  Status Meet(const Sha256Digest& mesh, const CancelToken& cancel);

  /// Puts a tree into the store, or finds it there; see SharedStore::Publish. It is not taken back
  /// if a later step fails: another library may have acknowledged it since.
  Result<SharedStore::Published> Publish(const TreeId& id, const ReadableFile& mesh);
  /// The registry knows the tree now, which existed after `seen`.
  void Confirm(const TreeId& id, SharedStore::Clock::time_point seen);
  /// False if no tree has the id.
  Result<bool> Remove(const TreeId& id);
  /// In the background; no effect if it fails.
  void RemoveLater(const TreeId& id) noexcept;

  /// As TreeRegistry::List, of all libraries.
  Result<std::vector<TreeInfo>> List(const std::optional<Sha256Digest>& mesh,
                                     const std::optional<TreePosition>& after, std::size_t limit);

  /// The mesh's file is in the data directory after success: fetched, with its hash checked, unless
  /// it is there and sound. kCorrupt if no copy in the store has the right bytes.
  Status BringMesh(const Sha256Digest& mesh, const CancelToken& cancel);
  /// BringMesh; and the tree's file, if the store has it.
  Status BringFiles(const TreeRecord& record, const CancelToken& cancel);
  /// Puts the tree's file and its new record into the store, in the background; no effect if that
  /// fails.
  void StoreLater(const TreeRecord& record, BuildKind build) noexcept;

  /// Files that were needed.
  struct FileCounts {
    std::uint64_t here = 0;     ///< in the data directory
    std::uint64_t fetched = 0;  ///< from the store
  };
  struct Counts {
    std::uint64_t lookups = 0;  ///< questions whether a tree exists
    FileCounts meshes, trees;   ///< a tree that is nowhere is built
    StoreCounts requests;
    RetryingStore::Counts retries;
  };
  Counts counts() const;

  /// Ends what is under way, and waits for it.
  void Stop();

 private:
  using Clock = SharedStore::Clock;
  // A question whether a tree exists, shared by all who ask it.
  struct Lookup {
    const Clock::time_point started = Clock::now();
    bool has_ended = false;
    Status status;
  };
  struct Buffer {
    MemoryCharge charge;
    std::vector<std::byte> bytes;
  };
  class FetchTurn;

  // Of a question that got no answer.
  static Error Unanswered(const Error& error);
  Result<Buffer> MakeBuffer(std::uint64_t object_bytes);
  // With mutex_ held:
  std::shared_ptr<Lookup> Begin(const TreeId& id);

  void Run(const TreeId& id, const std::shared_ptr<Lookup>& lookup) noexcept;
  Status Ask(const TreeId& id, Clock::time_point started);
  void Adopt(const SharedStore::Found& found);
  void RemoveHere(const TreeId& id, Clock::time_point asked);
  Status FetchMesh(const Sha256Digest& mesh, std::uint64_t bytes, const CancelToken& cancel);
  Status PlaceMesh(const Sha256Digest& mesh, NewMesh file);
  void BringTree(const Sha256Digest& mesh, BuildKind build, const CancelToken& cancel);
  void Note(std::uint64_t FileCounts::*where, FileCounts Counts::*what);
  void Store(const TreeRecord& record, BuildKind build);
  void SubmitTransfer(const Sha256Digest& mesh, std::function<void()> job) noexcept;
  Result<std::vector<SharedStore::Listed>> ListPage(const std::optional<TreePosition>& after,
                                                    std::size_t limit, bool* has_more);
  Result<std::vector<TreeInfo>> Describe(std::vector<SharedStore::Listed> entries);
  Result<std::vector<TreeInfo>> ListOf(const Sha256Digest& mesh);

  const std::chrono::milliseconds confirm_every_;
  const Parts parts_;
  CountingStore counting_;
  RetryingStore objects_;
  SharedStore shared_;
  const CancelToken stop_ = CancelToken::Cancellable();

  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::map<TreeId, Clock::time_point> confirmed_;
  std::size_t prune_at_ = 1024;  // entries of confirmed_
  std::map<TreeId, std::shared_ptr<Lookup>> lookups_;
  std::set<Sha256Digest> fetching_;
  Counts counts_;

  // Last: their threads use all of the above.
  WorkQueue lookup_queue_;
  WorkQueue transfer_queue_;
};

}  // namespace kdray::core
