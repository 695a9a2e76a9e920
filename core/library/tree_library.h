// SPDX-License-Identifier: Apache-2.0
// The trees of one data directory by their ids: uploads, builds, memory, disk, deletion. Core's
// interface for a server, independent of the protocol. It only connects its parts: the state is in
// tree_registry.h, the work in mesh_intake.h, tree_builder.h, scene_loader.h, tree_remover.h,
// binary_rebuilder.h, attribute_loader.h and measurer.h, what is shared with other libraries in
// shared_trees.h.
#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <vector>

#include "core/base/cancel.h"
#include "core/base/parallel.h"
#include "core/base/result.h"
#include "core/catalog/tree_id.h"
#include "core/io/mesh_attributes.h"
#include "core/library/attribute_loader.h"
#include "core/library/binary_rebuilder.h"
#include "core/library/measurements.h"
#include "core/library/measurer.h"
#include "core/library/memory_budget.h"
#include "core/library/mesh_intake.h"
#include "core/library/mesh_locks.h"
#include "core/library/scene_loader.h"
#include "core/library/shared_trees.h"
#include "core/library/tree_builder.h"
#include "core/library/tree_cache.h"
#include "core/library/tree_registry.h"
#include "core/library/tree_remover.h"
#include "core/library/work_queue.h"
#include "core/scene/scene.h"
#include "core/store/scene_store.h"

namespace kdray::core {

struct LibraryOptions {
  std::filesystem::path data_dir;
  FileSystem* file_system = nullptr;  ///< null: PosixFileSystem()
  int build_threads = 1;              ///< of the arena that meshes are parsed and trees built in
  std::uint64_t memory_limit_bytes = std::uint64_t{4} << 30;
  std::optional<std::uint64_t> store_limit_bytes;
  /// A store that libraries share. Then the data directory is a cache of it, ids that are not known
  /// are looked up there, and every method may return StoreIsAway.
  SharedTreesOptions shared;
  /// How long a failed build's error is kept: a permanent one, and one that may succeed later.
  std::chrono::milliseconds keep_failure{std::chrono::minutes(10)};
  std::chrono::milliseconds retry_after{std::chrono::seconds(10)};
};

struct LibraryCounters {
  std::uint64_t parses = 0, builds = 0, loads = 0, rebuilds = 0;
  std::uint64_t cache_hits = 0;       ///< calls of Load that found the scene in memory
  std::uint64_t binary_rebuilds = 0;  ///< BinaryRebuilder
  std::uint64_t attribute_reads = 0;  ///< AttributeLoader
  std::uint64_t damaged_files = 0, evictions = 0;
  std::uint64_t memory_bytes = 0, store_bytes = 0, trees = 0;
  std::uint64_t unrecorded_meshes = 0;        ///< stored meshes without a tree (SceneStore)
  std::uint64_t unreadable_meshes = 0;        ///< meshes of trees, damaged or missing
  std::optional<SharedTrees::Counts> shared;  ///< nullopt without a shared store
};

/// Every method is safe from many threads at once. All methods that take an id may return
/// kNotFound, or the error of its failed build (those of SceneLoader::Load).
class TreeLibrary {
 public:
  /// Reads the stored records and resumes interrupted builds. A build that two starts resumed, and
  /// neither finished nor stopped in an orderly Shutdown, may be what ends the process. It waits
  /// until its tree is asked for. A tree whose mesh cannot be read stays; its mesh is kCorrupt
  /// until the same bytes are uploaded again. Errors: SceneStore::Open and Load.
  static Result<std::unique_ptr<TreeLibrary>> Open(const LibraryOptions& options);
  ~TreeLibrary();

  using Upload = MeshUpload;
  /// `bytes` is the declared size, or less if it is not known. It reserves no memory, and no file
  /// is evicted for it. kMeshTooLarge if such a mesh exceeds a limit; kMemoryFull if running builds
  /// leave no memory for it now; kStoreFull if the disk has no room.
  Result<Upload> BeginUpload(std::uint64_t bytes);

  using Added = MeshIntake::Added;
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

  /// The attributes of the tree's mesh, of these kinds at least. Errors: those of
  /// AttributeLoader::Load.
  Result<std::shared_ptr<const MeshAttributes>> LoadAttributes(const TreeId& id,
                                                               AttributeKinds kinds,
                                                               const CancelToken& cancel);

  /// The names of the mesh's groups (MeshAttributes::group_names): from their file, else from the
  /// mesh. Errors: those of LoadAttributes.
  Result<std::vector<std::string>> GroupNames(const TreeId& id, const CancelToken& cancel);

  using Position = TreePosition;
  /// At most `limit` of those after `after`, of one mesh or of all. With a shared store, of all
  /// libraries: only then it can fail.
  Result<std::vector<TreeInfo>> ListAll(const std::optional<Sha256Digest>& mesh,
                                        const std::optional<Position>& after, std::size_t limit);
  /// The same, of those that this library knows.
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

  /// The budget of meshes, trees and builds, from which others may borrow: TryReserve evicts idle
  /// trees. Charges must end before the library.
  MemoryBudget* memory() { return &budget_; }

  /// Stops builds, which resume at the next Open, and the writing of large derived files, which are
  /// made again when needed. Nothing is built or loaded after it.
  void Shutdown();

 private:
  // Short jobs that requests wait for, and builds; each build uses the whole arena.
  static constexpr int kLoadThreads = 2;
  static constexpr int kBuildThreads = 2;
  // Threads of jobs that wait for memory.
  static constexpr int kAsideThreads = 32;

  TreeLibrary(const LibraryOptions& options, std::unique_ptr<SceneStore> store);
  Status Ensure(const TreeId& id, const CancelToken& cancel);
  Status CheckMesh(const TreeId& id, const CancelToken& cancel);
  std::optional<Scene> FindInMemory(const Sha256Digest& mesh, BuildKind build);

  std::unique_ptr<SceneStore> store_;
  MemoryBudget budget_;
  TreeCache cache_;
  std::atomic<std::uint64_t> cache_hits_{0};
  Arena arena_;
  MeshLocks mesh_locks_;
  TreeRegistry registry_;
  Measurements measurements_;
  SceneLoader loader_;
  TreeRemover remover_;
  std::unique_ptr<SharedTrees> shared_;  // null without a shared store
  MeshIntake intake_;
  BinaryRebuilder binary_rebuilder_;
  AttributeLoader attribute_loader_;
  WorkQueue queue_;
  TreeBuilder builder_;
  Measurer measurer_;
};

}  // namespace kdray::core
