// SPDX-License-Identifier: Apache-2.0
// The trees that exist and the task that runs for each: the state of TreeLibrary, without its work
// (tree_builder.h, tree_remover.h).
#pragma once

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "core/base/hash.h"
#include "core/base/result.h"
#include "core/catalog/records.h"
#include "core/catalog/tree_id.h"
#include "core/library/loaded_scene.h"
#include "core/library/memory_budget.h"
#include "core/library/tree_task.h"

namespace kdray::core {

/// A tree's description.
struct TreeInfo {
  TreeRecord record;  ///< `tree` is set exactly if it is ready
  double progress = 0;
  bool ready() const { return record.tree.has_value(); }
};

/// A position in the list of trees: newest first, at equal time by id.
struct TreePosition {
  std::int64_t created_ms = 0;
  TreeId id;
  friend auto operator<=>(const TreePosition&, const TreePosition&) = default;
};

/// A state machine under one mutex: each method is one query or one event. It uses no disk, runs no
/// work and does not wait. Safe from many threads at once; mesh_locks.h has the order of locks.
///
/// An id is in one of these states:
///   absent  no tree has it. After a permanent failure of its build, its error is kept for a while.
///   due     recorded, not built. A task may be building it. After a failure, its error is kept for
///           a while.
///   ready   built. A task may be loading it.
/// At most one task runs for an id. After a task was ended, because its tree was removed or by
/// Shutdown, its events change nothing.
class TreeRegistry {
 public:
  using Clock = std::chrono::steady_clock;
  /// Hands a task to a worker. Called with the registry's mutex held. If it throws, no task starts.
  using Start = std::function<void(const std::shared_ptr<TreeTask>&)>;
  struct Rules {
    /// How long a failed build's error is kept: a permanent one, and one that may succeed later.
    Clock::duration keep_failure = std::chrono::minutes(10);
    Clock::duration retry_after = std::chrono::seconds(10);
    /// How long files that are being written at Shutdown may still take.
    Clock::duration time_to_store = std::chrono::milliseconds(100);
    /// Starts that resume a build which none of them finishes.
    std::uint32_t max_resumes = 2;
    /// Kept errors of absent ids: many broken meshes must not use unbounded memory.
    std::size_t max_failures = 10'000;
  };

  TreeRegistry(const Rules& rules, Start start, std::function<Clock::time_point()> now = Clock::now)
      : rules_(rules), start_(std::move(start)), now_(std::move(now)) {}

  /// The stored records, at the start of the process. Resumes builds that are due.
  void Adopt(std::vector<TreeRecord> records, std::set<Sha256Digest> damaged_meshes);
  /// Ends all tasks with kCancelled. None starts after it.
  void Shutdown();
  bool is_shut_down() const;

  // Queries. Errors: kNotFound, or that of a permanent failure.

  Status Check(const TreeId& id);
  Result<TreeInfo> Info(const TreeId& id);
  /// The build of a tree that is ready; nullopt while it is due.
  Result<std::optional<BuildKind>> ReadyBuild(const TreeId& id);
  /// At most `limit` trees after `after`, of one mesh or of all.
  std::vector<TreeInfo> List(const std::optional<Sha256Digest>& mesh,
                             const std::optional<TreePosition>& after, std::size_t limit) const;
  struct Counts {
    std::uint64_t trees = 0;
    std::uint64_t damaged_meshes = 0;
    std::uint64_t rebuilds = 0;  ///< builds of trees that had been ready before
  };
  Counts counts() const;

  // Asking for a tree.

  enum class Need : std::uint8_t { kReady, kInMemory };
  /// The running task, or a new one. Null if the tree is ready and that is enough. Errors: as
  /// above; the kept error of a failed task; kCancelled after Shutdown.
  Result<std::shared_ptr<TreeTask>> Ask(const TreeId& id, Need need);

  // Meshes.

  bool HasMesh(const Sha256Digest& mesh) const;
  /// HasMesh, and its file was not found damaged.
  bool HasSoundMesh(const Sha256Digest& mesh) const;
  struct MeshInfo {
    std::uint64_t bytes = 0;
    std::optional<MeshFacts> facts;
  };
  /// nullopt if no tree has it.
  std::optional<MeshInfo> FindMesh(const Sha256Digest& mesh) const;
  void NoteMeshStored(const Sha256Digest& mesh, std::uint64_t bytes);
  /// False if no tree has it.
  bool NoteMeshDamaged(const Sha256Digest& mesh);
  /// What the trees of a mesh need.
  struct Wanted {
    bool mesh = false;                                 ///< it has trees
    std::array<bool, kAllBuildKinds.size()> builds{};  ///< by BuildKind

    bool Has(BuildKind build) const { return builds[static_cast<std::size_t>(build)]; }
  };
  Wanted WantedOf(const Sha256Digest& mesh) const;
  /// Whether the files of a tree may still be written. After Shutdown a small file gets the time
  /// that it takes; without it the next start would parse or build again.
  bool MayStore(const Sha256Digest& mesh, BuildKind build) const;
  std::set<Sha256Digest> MeshesUnderWay() const;
  std::vector<TreeRecord> RecordsOf(const Sha256Digest& mesh) const;
  /// The ids of a mesh; nullopt if a task runs for one of them.
  std::optional<std::vector<TreeId>> IdleTreesOf(const Sha256Digest& mesh) const;

  // Adding trees. The caller holds the mesh's lock.

  bool IsReadyOrUnderWay(const TreeId& id) const;
  bool IsAnyUnderWay() const;
  struct Recorded {
    TreeRecord record;
    bool is_in_doubt = false;  ///< after an error of the disk: the file may be missing
  };
  /// nullopt for an absent id.
  std::optional<Recorded> FindRecord(const TreeId& id) const;

 private:
  struct Failure {
    Error error;
    Clock::time_point until;
  };
  struct Entry {
    TreeRecord record;
    bool is_new = false;             // made since Adopt: a mesh that cannot be built may be dropped
    bool is_in_doubt = false;        // Recorded::is_in_doubt
    std::shared_ptr<TreeTask> task;  // under way, if any
    std::optional<Failure> failure;  // of a task that may go better next time
  };
  using Entries = std::map<TreeId, Entry>;
  using Places = std::set<TreePosition, std::greater<>>;
  using Failures = std::map<TreeId, Failure>;

 public:
  /// A tree that is not added yet. It has allocated what Add needs.
  class NewTree {
   public:
    explicit NewTree(const TreeRecord& record);

   private:
    friend class TreeRegistry;
    Entries entry_;
    Places place_;
  };
  /// Its record is on disk. Starts its build; if that throws, the next request starts it.
  void Add(NewTree tree, MemoryCharge admission);
  /// A tree that another library made (shared_trees.h). Starts no task; the next request for the
  /// tree does.
  void AddKnown(NewTree tree);
  /// It was uploaded again, and its record is on disk. Starts its build if it is due, also after a
  /// failure.
  void AddAgain(const TreeId& id, MemoryCharge admission);
  /// The record was written.
  void ClearDoubt(const TreeId& id);

  // Removing trees. The caller holds the mesh's lock.

  /// Forgets the kept error of an absent id; false if there is none.
  bool ForgetFailure(const TreeId& id);
  /// The record will be removed, and is in doubt until then. nullopt for an absent id.
  std::optional<TreeRecord> BeginRemoval(const TreeId& id);
  /// The disk failed to remove the record. `is_in_doubt` unless it was written again.
  void EndRemoval(const TreeId& id, bool is_in_doubt);
  struct Removed {
    bool mesh_too = false;           ///< it was the mesh's last tree
    std::optional<BuildKind> build;  ///< that no other tree of the mesh has
  };
  /// The record was removed. Removes the tree and ends its task with `error`. nullopt for an absent
  /// id.
  std::optional<Removed> Remove(const TreeId& id, Error error) noexcept;

  // Events of tasks. They return false or nullopt if the task was ended.

  std::optional<TreeRecord> RecordOf(const TreeTask& task) const;
  /// The new count of resumes is on disk.
  bool NoteResumed(const TreeTask& task, std::uint32_t resumed);
  /// The count of resumes could not be written. The task ends, unless a request has asked for the
  /// tree.
  bool NoteResumeRefused(const TreeTask& task);
  void NoteParsed(const TreeTask& task, const MeshFacts& facts);
  bool Succeed(const TreeTask& task, const LoadedScene& loaded);
  /// A failure that is not recorded yet. It has allocated what that needs.
  class NewFailure {
   public:
    /// The same bytes would fail the same way, so the tree should be removed.
    bool is_for_good() const { return for_good_; }
    /// The tree was added since Adopt, not found.
    bool is_of_new_tree() const { return is_new_; }
    /// For those who wait.
    Error TakeError() { return std::move(told_); }

   private:
    friend class TreeRegistry;
    bool for_good_ = false;
    bool is_new_ = false;
    Failures kept_;
    Failure passing_;
    Error told_;
  };
  std::optional<NewFailure> Judge(const TreeTask& task, const Error& error);
  /// The record of its tree was removed: keeps the error for the id. Call Remove next.
  void FailForGood(NewFailure failure);
  /// The tree stays: keeps the error for a while.
  void FailForNow(const TreeTask& task, NewFailure failure);
  /// As FailForNow, for an error whose copy does not allocate.
  void GiveUp(const TreeTask& task, Error error) noexcept;

  /// The build of the record's tree, if it is known already: `auto` chooses while it builds.
  static std::optional<BuildKind> BuildOf(const TreeRecord& record);

 private:
  // All with mutex_ held:
  Result<Entry*> Find(const TreeId& id);
  const Entry* EntryOf(const TreeTask& task) const;  // null once the task was ended
  Entry* EntryOf(const TreeTask& task);
  template <class Visit>
  void ForEachOf(const Sha256Digest& mesh, const Visit& visit) const {
    for (auto entry = FirstOf(mesh); entry != entries_.end() && entry->first.mesh == mesh;
         ++entry) {
      visit(entry->second);
    }
  }
  Entries::const_iterator FirstOf(const Sha256Digest& mesh) const;  // or end()
  void StartTask(Entry* entry, TreeTask::Kind kind, MemoryCharge admission);
  static void EndTask(Entry* entry, std::optional<Scene> scene,
                      std::optional<Error> error) noexcept;
  void MakeRoomForFailure();
  static TreeInfo InfoOf(const Entry& entry);

  const Rules rules_;
  const Start start_;
  const std::function<Clock::time_point()> now_;

  mutable std::mutex mutex_;
  Entries entries_;
  Places by_age_;
  Failures failures_;  // of absent ids
  std::set<Sha256Digest> damaged_meshes_;
  bool is_shut_down_ = false;
  Clock::time_point store_until_;  // once shut down
  std::uint64_t rebuilds_ = 0;
};

}  // namespace kdray::core
