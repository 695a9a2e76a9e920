// SPDX-License-Identifier: Apache-2.0
// The data directory:
//   lock              held while a daemon uses the directory
//   cache-of          the name of the shared store, if the directory is a cache of one
//   meshes/<sha256>   the uploaded bytes
//   catalog/<id>      the records of trees (catalog.h): a mesh without a record is not served, and
//                     is kept until the same bytes are uploaded again or the limit needs its room
//   catalog/<sha256>-groups  the names of a mesh's groups, if it has any
//   parsed/<sha256>   derived: the parsed mesh (parsed_mesh_file.h)
//   trees/<sha256>-<build>   derived: the built tree (tree_file.h)
//   measured/<sha256>        derived: the trade-off that was measured (tradeoff_file.h)
// Derived files may be removed at any time. They are made again when needed, except measurements,
// which must be requested again.
#pragma once

#include <array>
#include <atomic>
#include <chrono>
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
#include <string_view>
#include <vector>

#include "core/accel/tree.h"
#include "core/base/cancel.h"
#include "core/base/hash.h"
#include "core/base/result.h"
#include "core/catalog/parsed_mesh.h"
#include "core/store/blob_store.h"
#include "core/store/catalog.h"
#include "core/store/disk_usage.h"
#include "core/store/file_system.h"
#include "core/store/sound_files.h"
#include "core/store/tradeoff_file.h"
#include "core/store/tree_file.h"

namespace kdray::core {

class SceneStore;

/// A mesh file that is being uploaded: hashed and written while it arrives. The destructor removes
/// it. For one thread at a time.
class NewMesh {
 public:
  /// kStoreFull if the disk has no room for them, even without derived files, or all unfinished
  /// uploads exceed the limit.
  Status Append(std::span<const std::byte> bytes);
  /// The hash of all appended bytes; call once, at the end.
  Sha256Digest Digest() { return hash_.Finish(); }
  /// Puts it on stable storage under a temporary name. SceneStore::Commit does so itself if this
  /// was not called, and gives it its name.
  Status Sync() { return blob_.Sync(); }
  std::uint64_t bytes() const { return blob_.bytes(); }
  /// The bytes so far, as NewBlob::Reopen.
  Result<std::unique_ptr<ReadableFile>> Reopen() const { return blob_.Reopen(); }

 private:
  friend class SceneStore;
  NewMesh(SceneStore* store, NewBlob blob, ArrivingRoom room)
      : store_(store), blob_(std::move(blob)), room_(std::move(room)) {}

  SceneStore* store_;
  NewBlob blob_;
  ArrivingRoom room_;
  Sha256 hash_;
};

/// Safe from many threads at once, except for two calls that write or remove files of the same
/// mesh, which the caller must serialise. Do not call it under a lock that a query needs.
class SceneStore {
 public:
  struct Options {
    FileSystem* file_system = nullptr;
    std::filesystem::path directory;
    std::optional<std::uint64_t> limit_bytes;  ///< of meshes and derived files together
    /// The name of the shared store (shared_store.h) whose cache the directory is; else empty.
    std::string cache_of = {};
  };
  /// Locks the directory for this process. Errors: kInvalidArgument if another process has it, or
  /// it is the cache of another store than `cache_of`, else those of FileSystem.
  static Result<std::unique_ptr<SceneStore>> Open(const Options& options);

  struct Contents {
    std::vector<TreeRecord> records;  ///< in no order
    std::set<Sha256Digest>
        unreadable_meshes;  ///< of the recorded ones: missing, foreign, truncated
  };
  /// Reads the records and lists the folders, which it makes if they do not exist. Call once, after
  /// Open. kInvalidArgument if it becomes a cache although it has trees, which would be lost.
  /// Removes only derived files without a mesh. Keeps every record, whatever the state of its mesh.
  /// kCorrupt, with nothing changed, when the directory is not what it was: a folder belongs to
  /// another user or cannot be read; one is missing although the catalog names meshes, or the
  /// catalog's although there are meshes; or at least two, and more than half, of the recorded
  /// meshes or of the records cannot be read.
  Result<Contents> Load();

  // Meshes.

  /// nullopt if the limit does not leave `bytes` free.
  std::optional<DiskRoom> TryReserve(std::uint64_t bytes) { return usage_.TryReserve(bytes); }
  /// Removes derived files, least recently used first, until the limit leaves `bytes` free. nullopt
  /// if that is not enough.
  std::optional<DiskRoom> MakeRoom(std::uint64_t bytes);
  /// The mesh to evict next, except those in `except` (hashes in hexadecimal).
  std::optional<Sha256Digest> OldestMesh(const std::set<std::string>& except) const;
  /// A mesh without a record, which is evicted before anything else.
  std::optional<Sha256Digest> OldestUnrecordedMesh() const;
  std::uint64_t unrecorded_meshes() const { return usage_.Count(FileGroup::kUnrecorded); }
  /// kStoreFull if the disk has no room for `bytes`, even without derived files, or cannot be
  /// written. Nothing is removed before the bytes arrive.
  Result<NewMesh> BeginMesh(std::uint64_t bytes);
  /// Durable when it returns; replaces a file of that name. `room`: the result of MakeRoom.
  Status Commit(const Sha256Digest& mesh, NewMesh file, DiskRoom room);
  /// Whether a readable file of this size exists. Does not read its bytes.
  bool HasMesh(const Sha256Digest& mesh, std::uint64_t bytes) const {
    return !WhyUnreadable(mesh, bytes).has_value();
  }
  /// kCorrupt if it is missing, cannot be read, or its bytes have another hash (this hashes the
  /// whole file, unless it is unchanged since that was done). Reading the result from front to back
  /// hashes it again: the last read is kCorrupt if the disk returned other bytes. Storing it again
  /// repairs it. kCancelled, kDeadlineExceeded, which say nothing
  /// about the file.
  Result<std::unique_ptr<ReadableFile>> OpenMesh(const Sha256Digest& mesh,
                                                 const CancelToken& cancel = {});
  Result<std::vector<std::byte>> ReadMesh(const Sha256Digest& mesh, const CancelToken& cancel = {});
  /// Removes the mesh's derived files, then its file, which must have no record. If the disk fails,
  /// it is an unrecorded mesh.
  Status RemoveMesh(const Sha256Digest& mesh);
  /// Marks a mesh file that has no record any more.
  void MarkUnrecorded(const Sha256Digest& mesh);
  /// Records a use, for OldestMesh.
  void UseMesh(const Sha256Digest& mesh);

  // Derived files. A lack of room for one is not an error, and neither is a cancelled write; it is
  // made again when needed. Reading one may also end with kCancelled or kDeadlineExceeded.

  /// About the memory that the mesh will take; 0 without a file.
  std::uint64_t ParsedFileBytes(const Sha256Digest& mesh) const;
  Result<ParsedMesh> ReadParsed(const Sha256Digest& mesh, const CancelToken& cancel = {});
  void WriteParsed(const Sha256Digest& mesh, const ParsedMesh& parsed,
                   const CancelToken& cancel = {});
  /// As ParsedFileBytes.
  std::uint64_t TreeFileBytes(const Sha256Digest& mesh, BuildKind build) const;
  Result<Tree> ReadTree(const TreeFileKey& key, const CancelToken& cancel = {});
  void WriteTree(const TreeFileKey& key, const Tree& tree, const CancelToken& cancel = {});
  void RemoveTree(const Sha256Digest& mesh, BuildKind build);
  /// The stored tree as bytes. kNotFound.
  Result<std::unique_ptr<ReadableFile>> OpenTree(const Sha256Digest& mesh, BuildKind build) const;
  /// Stores a tree of `bytes` bytes, which `fill` writes. Its error comes back, and nothing is
  /// stored. A lack of room is no error.
  Status StoreTree(const Sha256Digest& mesh, BuildKind build, std::uint64_t bytes,
                   const std::function<Status(NewBlob*)>& fill);

  /// kNotFound if there is no result.
  Result<MeasuredTradeoff> ReadTradeoff(const Sha256Digest& mesh);
  void WriteTradeoff(const Sha256Digest& mesh, const MeasuredTradeoff& measured);
  bool HasTradeoff(const Sha256Digest& mesh) const;
  /// Durable when it returns; success if there is no result.
  Status RemoveTradeoff(const Sha256Digest& mesh);

  // The catalog.

  Status SaveRecord(const TreeRecord& record) { return catalog_.Save(record); }
  Status RemoveRecord(const TreeId& id) { return catalog_.Remove(id); }
  Status RemoveRecordsOf(const Sha256Digest& mesh) { return catalog_.RemoveAllOf(mesh); }
  bool HasRecord(const TreeId& id) const { return catalog_.Has(id); }
  /// The names of a mesh's groups, which go with its records. kNotFound if they were not saved.
  Status SaveGroupNames(const Sha256Digest& mesh, std::span<const std::string> names) {
    return catalog_.SaveGroupNames(mesh, names);
  }
  Result<std::vector<std::string>> ReadGroupNames(const Sha256Digest& mesh) const {
    return catalog_.ReadGroupNames(mesh);
  }

  std::uint64_t bytes() const { return usage_.total(); }
  std::optional<std::uint64_t> limit() const { return usage_.limit(); }
  /// Files that failed their check, or could not be read, since Open.
  std::uint64_t damaged_files() const { return damaged_; }

 private:
  friend class NewMesh;

  using RecordedMeshes = std::map<Sha256Digest, std::uint64_t>;  // with their sizes
  using Files = std::array<std::vector<FileInfo>, kFileGroups>;  // by FileGroup

  // By FileGroup: a mesh keeps its place whether a record names it or not.
  static constexpr std::array<std::string_view, kFileGroups> kFolders = {
      "meshes", "parsed", "trees", "measured", "meshes"};
  static constexpr std::string_view kCatalogFolder = "catalog";

  explicit SceneStore(const Options& options);
  Status CheckCacheMark();
  Status MarkAsCache();
  Status MakeRoomForArrived(std::uint64_t bytes, ArrivingRoom* room);
  BlobStore& Blobs(FileGroup group) { return blobs_[static_cast<std::size_t>(group)]; }
  const BlobStore& Blobs(FileGroup group) const { return blobs_[static_cast<std::size_t>(group)]; }

  // Of the start (scene_store_load.cc):
  Result<std::set<std::string_view>> MissingFolders() const;
  static RecordedMeshes RecordedIn(const Catalog::Contents& catalog);
  static void CompleteSizes(const std::vector<FileInfo>& meshes, RecordedMeshes* recorded);
  Result<std::set<Sha256Digest>> UnreadableMeshes(const RecordedMeshes& recorded) const;
  void TakeStock(const RecordedMeshes& recorded, Files files);
  std::optional<std::string> WhyUnreadable(const Sha256Digest& mesh, std::uint64_t bytes) const;

  void RemoveDerived(FileGroup group, const std::string& name);
  bool RemoveOldestDerived();
  template <class Write>
  void WriteDerived(FileGroup group, const std::string& name, std::uint64_t bytes_expected,
                    const Write& write);
  Result<std::unique_ptr<ReadableFile>> OpenCounted(FileGroup group, const std::string& name);
  void CountDamage(const Error& error);

  FileSystem* const file_system_;
  const std::filesystem::path directory_;
  const std::string cache_of_;
  bool is_marked_as_cache_ = false;
  std::unique_ptr<FileLock> lock_;
  std::array<BlobStore, kFileGroups> blobs_;  // by FileGroup
  Catalog catalog_;
  DiskUsage usage_;
  std::atomic<std::uint64_t> damaged_{0};

  SoundFiles sound_meshes_;
  std::mutex touched_mutex_;
  std::map<Sha256Digest, std::chrono::steady_clock::time_point> touched_;
};

}  // namespace kdray::core
