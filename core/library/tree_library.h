// The trees of one data directory by their ids: uploads, builds, memory, disk, deletion. Core's
// interface for a server, independent of the protocol.
#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <filesystem>
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
#include "core/base/parallel.h"
#include "core/base/result.h"
#include "core/catalog/tree_id.h"
#include "core/library/binary_rebuilder.h"
#include "core/library/measurements.h"
#include "core/library/memory_budget.h"
#include "core/library/scene_source.h"
#include "core/library/tree_cache.h"
#include "core/library/work_queue.h"
#include "core/scene/scene.h"
#include "core/store/catalog.h"
#include "core/store/scene_store.h"

namespace kdray::core {

struct LibraryOptions {
  std::filesystem::path data_dir;
  FileSystem* file_system = nullptr;  ///< null: PosixFileSystem()
  int build_threads = 1;              ///< of the arena that meshes are parsed and trees built in
  std::uint64_t memory_limit_bytes = std::uint64_t{4} << 30;
  std::optional<std::uint64_t> store_limit_bytes;
  /// How long a failed build's error is kept: a permanent one, and one that may succeed later.
  std::chrono::milliseconds keep_failure{std::chrono::minutes(10)};
  std::chrono::milliseconds retry_after{std::chrono::seconds(10)};
};

/// A tree's description.
struct TreeInfo {
  TreeRecord record;  ///< `tree` is set exactly if it is ready
  double progress = 0;
  bool ready() const { return record.tree.has_value(); }
};

struct LibraryCounters {
  std::uint64_t parses = 0, builds = 0, loads = 0, rebuilds = 0;
  std::uint64_t binary_rebuilds = 0;  ///< BinaryRebuilder
  std::uint64_t damaged_files = 0, evictions = 0;
  std::uint64_t memory_bytes = 0, store_bytes = 0, trees = 0;
  std::uint64_t unrecorded_meshes = 0;  ///< stored meshes without a tree (SceneStore)
  std::uint64_t unreadable_meshes = 0;  ///< meshes of trees, damaged or missing
};

/// Every method is safe from many threads at once. All methods that take an id may return
/// kNotFound, or the error of its failed build (those of SceneSource::Fetch).
class TreeLibrary {
 public:
  /// Reads the stored records and resumes interrupted builds. A build that two starts resumed, and
  /// neither finished nor stopped in an orderly Shutdown, may be what ends the process. It waits
  /// until its tree is asked for. A tree whose mesh cannot be read stays; its mesh is kCorrupt
  /// until the same bytes are uploaded again. Errors: SceneStore::Open and Load.
  static Result<std::unique_ptr<TreeLibrary>> Open(const LibraryOptions& options);
  ~TreeLibrary();

  /// An unfinished upload; the destructor removes it. For one thread at a time. The library must
  /// outlive it.
  class Upload {
   public:
    Status Append(std::span<const std::byte> bytes) { return file_.Append(bytes); }

   private:
    friend class TreeLibrary;
    explicit Upload(NewMesh file) : file_(std::move(file)) {}
    NewMesh file_;
  };
  /// `bytes` is the declared size. It reserves no memory, and no file is evicted for it.
  /// kMeshTooLarge if such a mesh exceeds a limit; kMemoryFull if running builds leave no memory
  /// for it now; kStoreFull if the disk has no room.
  Result<Upload> BeginUpload(std::uint64_t bytes);

  struct Added {
    TreeId id;
    bool existed = false;
  };
  /// When this returns, mesh and record are durable, and the build is running or done. Under a
  /// store limit other meshes may be evicted for it, least recently used first. kEmptyMesh without
  /// a byte; kMemoryFull if running builds leave no memory for it; kStoreFull; kIo.
  Result<Added> Finish(Upload upload, std::optional<BuildKind> build);
  /// Another build of a stored mesh; kNotFound without the mesh.
  Result<Added> AddBuild(const Sha256Digest& mesh, std::optional<BuildKind> build);

  Result<TreeInfo> Find(const TreeId& id);
  /// As Find, after the tree is ready, has failed or was deleted, or at `until` or `cancel`.
  Result<TreeInfo> Wait(const TreeId& id, std::chrono::steady_clock::time_point until,
                        const CancelToken& cancel);

  /// The tree in memory. Waits for its build or load until `cancel` stops: then kDeadlineExceeded
  /// or kCancelled, or kMemoryFull if it was waiting for memory. kCancelled after Shutdown.
  Result<Scene> Load(const TreeId& id, const CancelToken& cancel);
  /// As Load, with the binary tree that cells and counted steps are taken from (Scene::Cells,
  /// TraceCostly). Errors besides: those of BinaryRebuilder::Ensure.
  Result<Scene> LoadWithBinary(const TreeId& id, const CancelToken& cancel);

  /// A position in the list: newest first, at equal time by id.
  struct Position {
    std::int64_t created_ms = 0;
    TreeId id;
    friend auto operator<=>(const Position&, const Position&) = default;
  };
  /// At most `limit` trees after `after`, of one mesh or of all.
  std::vector<TreeInfo> List(const std::optional<Sha256Digest>& mesh,
                             const std::optional<Position>& after, std::size_t limit);

  /// The tree is durably deleted when this returns; a running build stops soon. The mesh is deleted
  /// with its last tree. kStoreFull or kIo if the disk fails: then the tree still exists, but after
  /// a restart it may be gone, unless its record can be written or it is uploaded again.
  Status Delete(const TreeId& id);

  /// The mesh's bytes, all of which are read and checked first. kCorrupt if they are damaged;
  /// uploading them again repairs them. kCancelled, kDeadlineExceeded.
  Result<std::unique_ptr<ReadableFile>> OpenMesh(const TreeId& id, const CancelToken& cancel = {});

  /// Measures speed and accuracy on the mesh of `id` (core/tradeoff) in the background, one mesh at
  /// a time; the mesh's other ids share the result. Joins a running measurement, or starts a new
  /// one. Ignores the number of threads in `options`; running builds and loads count as
  /// disturbances, in addition to is_disturbed.
  Status Measure(const TreeId& id, TradeoffOptions options);
  /// The result or the progress; nullopt without a measurement. Waits until it has ended, or until
  /// `until` or `cancel`. Additional errors: those of Load and MeasureTradeoff if it fails during
  /// the wait; kMemoryFull if there was no memory for it.
  Result<std::optional<Measurements::Info>> WaitForMeasured(
      const TreeId& id, std::chrono::steady_clock::time_point until, const CancelToken& cancel);
  /// Stops the measurement and durably deletes the result. False if there was neither; kStoreFull
  /// or kIo if the disk fails.
  Result<bool> ForgetMeasured(const TreeId& id);

  LibraryCounters counters() const;

  /// Stops builds, which resume at the next Open, and the writing of large derived files, which are
  /// made again when needed. Nothing is built or loaded after it.
  void Shutdown();

 private:
  struct Flight;
  struct Failure {
    Error error;
    std::chrono::steady_clock::time_point until;
  };
  struct Entry {
    TreeRecord record;
    bool is_new = false;             // created since Open: an invalid mesh may be dropped
    bool is_in_doubt = false;        // the disk failed: the record may be missing, or not durable
    std::shared_ptr<Flight> flight;  // the running load or build, if any
    std::optional<Failure> failure;  // of work that may succeed next time
  };
  using Entries = std::map<TreeId, Entry>;

  // Short jobs that requests wait for, and builds; each build uses the whole arena.
  static constexpr int kLoadThreads = 2;
  static constexpr int kBuildThreads = 2;
  // Threads of jobs that wait for memory.
  static constexpr int kAsideThreads = 32;

  TreeLibrary(const LibraryOptions& options, std::unique_ptr<SceneStore> store);
  void Adopt(SceneStore::Contents contents);
  Result<DiskRoom> MakeRoom(std::uint64_t bytes);
  bool IsStored(const Sha256Digest& mesh, std::uint64_t bytes);
  Error TooLargeForStore(std::uint64_t bytes) const;
  std::uint64_t UsualPrepareBytes(std::uint64_t mesh_bytes) const;
  Result<MemoryCharge> Pledge(const TreeId& id, std::uint64_t mesh_bytes);
  Result<Added> Add(const TreeId& id, std::uint64_t mesh_bytes, MemoryCharge pledge);
  Result<Added> AddAgain(const TreeId& id, MemoryCharge pledge);
  Status RemoveRecord(const TreeId& id);
  Status DropMesh(const Sha256Digest& mesh);
  Status DropUnrecordedMesh(const Sha256Digest& mesh);
  void GiveUpAdding(const TreeId& id) noexcept;
  void ForgetIfUnused(const Sha256Digest& mesh) noexcept;
  void ForgetAndRemoveFiles(const TreeId& id, Error error) noexcept;
  Status RemoveUnusedMesh(const Sha256Digest& mesh);
  std::mutex& MeshMutex(const Sha256Digest& mesh) {
    return mesh_mutexes_[mesh.bytes[0] % mesh_mutexes_.size()];
  }

  // With mutex_ held:
  Result<Entry*> FindLocked(const TreeId& id);
  Entries::iterator FirstOf(const Sha256Digest& mesh);  // of the mesh's ids, or end()
  bool HasMesh(const Sha256Digest& mesh);
  bool IsWanted(const Sha256Digest& mesh, BuildKind build);  // by any id
  std::optional<Scene> FindInMemory(const Entry& entry);
  std::optional<Error> EnsureFlight(Entry* entry);  // the error if there cannot be one
  void StartFlight(Entry* entry, MemoryCharge pledge, bool is_resumed = false);
  static void Land(Entry* entry, std::optional<Error> error) noexcept;
  Entry* EntryOf(const Flight& flight);
  void MakeWayForFailure();
  static TreeInfo InfoOf(const Entry& entry);
  static std::optional<BuildKind> BuildOf(const TreeRecord& record);

  // The worker's side:
  void Fly(const std::shared_ptr<Flight>& flight) noexcept;
  void FlyNow(const std::shared_ptr<Flight>& flight);
  bool CountResume(Flight* flight);
  void UncountResume(const TreeId& id);
  void GiveUp(Flight* flight, Error error) noexcept;
  void EraseUnwanted(const Sha256Digest& mesh) noexcept;
  bool Succeed(Flight* flight, const SceneSource::Fetched& fetched);
  void Persist(const TreeRecord& before, const SceneSource::Fetched& fetched);
  bool MayStore(const Sha256Digest& mesh, BuildKind build);
  void Fail(Flight* flight, const Error& error);
  void RunMeasuring(const TreeId& id, const std::shared_ptr<Measurements::Task>& task,
                    const TradeoffOptions& options) noexcept;
  Result<MeasuredTradeoff> MeasureNow(const TreeId& id, TradeoffOptions options,
                                      Measurements::Task* task);

  const LibraryOptions options_;
  std::unique_ptr<SceneStore> store_;
  MemoryBudget budget_;
  MemoryBudget pledges_;  // memory that running builds will need
  TreeCache cache_;
  Arena arena_;
  SceneSource source_;
  BinaryRebuilder binary_rebuilder_;
  Measurements measurements_;

  // Held while a mesh's files are written or removed; always locked before mutex_.
  std::array<std::mutex, 64> mesh_mutexes_;

  mutable std::mutex mutex_;  // guards what follows; never held during disk work
  Entries entries_;
  std::set<Position, std::greater<>> by_age_;
  std::map<TreeId, Failure> failures_;  // of deleted ids
  std::set<Sha256Digest> damaged_meshes_;
  bool shut_down_ = false;
  std::chrono::steady_clock::time_point store_until_;  // once shut down
  std::uint64_t rebuilds_ = 0;

  WorkQueue queue_;  // last: its threads use all of the above
};

}  // namespace kdray::core
