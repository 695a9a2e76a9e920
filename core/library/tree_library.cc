#include "core/library/tree_library.h"

#include <algorithm>
#include <string>
#include <utility>

#include "core/library/flight.h"
#include "core/library/parse_mesh.h"

namespace kdray::core {
namespace {

using SteadyClock = std::chrono::steady_clock;

// Poll interval of waiters; CancelToken has no notification.
constexpr std::chrono::milliseconds kLookAgain{50};

// A build that was cut off is resumed by at most this many starts in a row.
constexpr std::uint32_t kMaxResumes = 2;

std::int64_t NowMs() {
  return std::chrono::duration_cast<std::chrono::milliseconds>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

Error NoSuchTree() { return Error{ErrorCode::kNotFound, "no tree has this id"}; }
Error NoMemoryForBuilds() {
  return Error{ErrorCode::kMemoryFull, "the builds under way need all memory"};
}
Error NoSuchMesh() { return Error{ErrorCode::kNotFound, "no mesh has this SHA-256"}; }

}  // namespace

TreeLibrary::TreeLibrary(const LibraryOptions& options, std::unique_ptr<SceneStore> store)
    : options_(options),
      store_(std::move(store)),
      budget_(options.memory_limit_bytes),
      pledges_(options.memory_limit_bytes),
      arena_(options.build_threads),
      source_(store_.get(), &cache_, &budget_, &arena_),
      binary_rebuilder_(&budget_, &arena_),
      queue_(kLoadThreads, kBuildThreads, kAsideThreads) {
  budget_.set_reclaim([this](std::uint64_t bytes) { return cache_.EvictIdleIfEnough(bytes); });
}

Result<std::unique_ptr<TreeLibrary>> TreeLibrary::Open(const LibraryOptions& options) {
  FileSystem* file_system =
      options.file_system != nullptr ? options.file_system : &PosixFileSystem();
  Result<std::unique_ptr<SceneStore>> store =
      SceneStore::Open({file_system, options.data_dir, options.store_limit_bytes});
  if (!store.ok()) return std::move(store).error();
  Result<SceneStore::Contents> contents = (*store)->Load();
  if (!contents.ok()) return std::move(contents).error();
  std::unique_ptr<TreeLibrary> library(new TreeLibrary(options, *std::move(store)));
  library->Adopt(*std::move(contents));
  return library;
}

TreeLibrary::~TreeLibrary() { Shutdown(); }

void TreeLibrary::Adopt(SceneStore::Contents contents) {
  const std::lock_guard lock(mutex_);
  damaged_meshes_ = std::move(contents.unreadable_meshes);
  for (TreeRecord& record : contents.records) {
    const TreeId id = record.id;
    by_age_.insert({record.created_ms, id});
    Entry& entry = entries_[id];
    entry.record = std::move(record);
    if (entry.record.tree || entry.record.resumed >= kMaxResumes) continue;
    StartFlight(&entry, MemoryCharge(), true);
  }
}

Result<TreeLibrary::Upload> TreeLibrary::BeginUpload(std::uint64_t bytes) {
  if (store_->limit() && bytes > *store_->limit()) return TooLargeForStore(bytes);
  if (Status status = budget_.CheckCouldFit(LeastPrepareBytes(bytes)); !status.ok()) {
    return std::move(status).error();
  }
  if (!pledges_.TryReserve(UsualPrepareBytes(bytes))) return NoMemoryForBuilds();
  Result<NewMesh> file = store_->BeginMesh(bytes);
  if (!file.ok()) return std::move(file).error();
  return Upload(*std::move(file));
}

Error TreeLibrary::TooLargeForStore(std::uint64_t bytes) const {
  return Error{ErrorCode::kMeshTooLarge, "a mesh of " + std::to_string(bytes) +
                                             " bytes is larger than the store, which takes " +
                                             std::to_string(*store_->limit())};
}

// Evicts meshes without a record first, then derived files, then whole meshes without running work.
Result<DiskRoom> TreeLibrary::MakeRoom(std::uint64_t bytes) {
  if (store_->limit() && bytes > *store_->limit()) return TooLargeForStore(bytes);
  for (;;) {
    if (std::optional<DiskRoom> room = store_->TryReserve(bytes)) return *std::move(room);
    if (const std::optional<Sha256Digest> unrecorded = store_->OldestUnrecordedMesh()) {
      if (Status status = DropUnrecordedMesh(*unrecorded); !status.ok()) {
        return std::move(status).error();
      }
      continue;
    }
    if (std::optional<DiskRoom> room = store_->MakeRoom(bytes)) return *std::move(room);
    std::set<std::string> busy;
    {
      const std::lock_guard lock(mutex_);
      for (const auto& [id, entry] : entries_) {
        if (entry.flight) busy.insert(id.mesh.ToHex());
      }
    }
    const std::optional<Sha256Digest> victim = store_->OldestMesh(busy);
    if (!victim) return Error{ErrorCode::kStoreFull, "the store has no room for this mesh now"};
    if (Status status = DropMesh(*victim); !status.ok()) return std::move(status).error();
  }
}

Result<TreeLibrary::Added> TreeLibrary::Finish(Upload upload, std::optional<BuildKind> build) {
  const std::uint64_t bytes = upload.file_.bytes();
  if (bytes == 0) return Error{ErrorCode::kEmptyMesh, "the mesh has no bytes"};
  const TreeId id{upload.file_.Digest(), build};
  // Before anything is evicted for it. It may still fail later.
  if (Result<MemoryCharge> pledge = Pledge(id, bytes); !pledge.ok()) {
    return std::move(pledge).error();
  }
  std::optional<DiskRoom> room;
  for (;;) {
    // The slow part before the lock.
    if (!room && !IsStored(id.mesh, bytes)) {
      Result<DiskRoom> made = MakeRoom(bytes);
      if (!made.ok()) return std::move(made).error();
      room.emplace(*std::move(made));
      if (Status status = upload.file_.Sync(); !status.ok()) return std::move(status).error();
    }
    const std::lock_guard files_lock(MeshMutex(id.mesh));
    const bool is_stored = IsStored(id.mesh, bytes);
    if (!is_stored && !room) continue;  // deleted meanwhile
    Result<MemoryCharge> pledge = Pledge(id, bytes);
    if (!pledge.ok()) return std::move(pledge).error();
    if (!is_stored) {
      Status status = store_->Commit(id.mesh, std::move(upload.file_), *std::move(room));
      if (!status.ok()) {
        (void)RemoveUnusedMesh(id.mesh);
        return std::move(status).error();
      }
      const std::lock_guard lock(mutex_);
      damaged_meshes_.erase(id.mesh);
      for (auto entry = FirstOf(id.mesh); entry != entries_.end() && entry->first.mesh == id.mesh;
           ++entry) {
        entry->second.record.mesh_bytes = bytes;
      }
    }
    try {
      return Add(id, bytes, *std::move(pledge));
    } catch (...) {
      ForgetIfUnused(id.mesh);
      throw;
    }
  }
}

bool TreeLibrary::IsStored(const Sha256Digest& mesh, std::uint64_t bytes) {
  {
    const std::lock_guard lock(mutex_);
    if (!HasMesh(mesh) || damaged_meshes_.contains(mesh)) return false;
  }
  return store_->HasMesh(mesh, bytes);
}

// No pledge for a tree that is ready or has running work.
Result<MemoryCharge> TreeLibrary::Pledge(const TreeId& id, std::uint64_t mesh_bytes) {
  {
    const std::lock_guard lock(mutex_);
    const auto found = entries_.find(id);
    if (found != entries_.end() && (found->second.record.tree || found->second.flight)) {
      return MemoryCharge();
    }
  }
  std::optional<MemoryCharge> pledge = pledges_.TryReserve(UsualPrepareBytes(mesh_bytes));
  if (!pledge) return NoMemoryForBuilds();
  return *std::move(pledge);
}

// The pledge for a mesh. A mesh that needs more is still accepted alone.
std::uint64_t TreeLibrary::UsualPrepareBytes(std::uint64_t mesh_bytes) const {
  return std::min(EstimatePrepareBytes(mesh_bytes), pledges_.limit());
}

Result<TreeLibrary::Added> TreeLibrary::AddBuild(const Sha256Digest& mesh,
                                                 std::optional<BuildKind> build) {
  const std::lock_guard files_lock(MeshMutex(mesh));
  std::uint64_t bytes = 0;
  {
    const std::lock_guard lock(mutex_);
    const auto sibling = FirstOf(mesh);
    if (sibling == entries_.end()) return NoSuchMesh();
    bytes = sibling->second.record.mesh_bytes;
  }
  Result<MemoryCharge> pledge = Pledge({mesh, build}, bytes);
  if (!pledge.ok()) return std::move(pledge).error();
  return Add({mesh, build}, bytes, *std::move(pledge));
}

// The caller holds the mesh's mutex and has put its bytes on disk.
Result<TreeLibrary::Added> TreeLibrary::Add(const TreeId& id, std::uint64_t mesh_bytes,
                                            MemoryCharge pledge) {
  TreeRecord record;
  record.id = id;
  record.created_ms = NowMs();
  record.mesh_bytes = mesh_bytes;
  bool existed = false;
  {
    const std::lock_guard lock(mutex_);
    existed = entries_.contains(id);
    if (const auto sibling = FirstOf(id.mesh); sibling != entries_.end()) {
      record.mesh = sibling->second.record.mesh;
    }
  }
  if (existed) return AddAgain(id, std::move(pledge));
  // Allocates everything before the record is written; later steps cannot fail.
  std::set<Position, std::greater<>> place;
  place.insert({record.created_ms, id});
  Entries added;
  added[id].is_new = true;
  added[id].record = record;
  try {
    if (Status status = store_->SaveRecord(record); !status.ok()) {
      GiveUpAdding(id);
      return status.error();
    }
  } catch (...) {
    GiveUpAdding(id);
    throw;
  }
  const std::lock_guard lock(mutex_);
  failures_.erase(id);
  by_age_.insert(place.extract(place.begin()));
  Entry& entry = entries_.insert(added.extract(added.begin())).position->second;
  // If this fails, the tree still exists, and the next request for it starts its build.
  StartFlight(&entry, std::move(pledge));
  return Added{id, false};
}

// After a record could not be written. Files that remain because of the disk, or for lack of
// memory, were not acknowledged; the next start finds them.
void TreeLibrary::GiveUpAdding(const TreeId& id) noexcept {
  try {
    (void)store_->RemoveRecord(id);
  } catch (...) {
  }
  ForgetIfUnused(id.mesh);
}

void TreeLibrary::ForgetIfUnused(const Sha256Digest& mesh) noexcept {
  try {
    (void)RemoveUnusedMesh(mesh);
  } catch (...) {
  }
}

// The same for an existing id, which cannot be deleted while the caller holds the mesh's mutex.
Result<TreeLibrary::Added> TreeLibrary::AddAgain(const TreeId& id, MemoryCharge pledge) {
  TreeRecord record;
  bool is_in_doubt = false;
  {
    const std::lock_guard lock(mutex_);
    const Entry& entry = entries_.at(id);
    record = entry.record;
    is_in_doubt = entry.is_in_doubt;
  }
  // The answer guarantees a record on disk. A failed deletion, or another process, may have removed
  // it.
  if (is_in_doubt || !store_->HasRecord(id)) {
    if (Status status = store_->SaveRecord(record); !status.ok()) return std::move(status).error();
  }
  const std::lock_guard lock(mutex_);
  Entry& entry = entries_.at(id);
  entry.is_in_doubt = false;
  entry.failure.reset();  // a new request tries again
  if (entry.flight) {
    entry.flight->is_asked_for = true;
  } else if (!entry.record.tree) {
    StartFlight(&entry, std::move(pledge));
  }
  return Added{id, true};
}

Result<TreeLibrary::Entry*> TreeLibrary::FindLocked(const TreeId& id) {
  if (const auto found = entries_.find(id); found != entries_.end()) return &found->second;
  if (const auto failed = failures_.find(id); failed != failures_.end()) {
    if (SteadyClock::now() < failed->second.until) return failed->second.error;
    failures_.erase(failed);
  }
  return NoSuchTree();
}

TreeInfo TreeLibrary::InfoOf(const Entry& entry) {
  TreeInfo info;
  info.record = entry.record;
  info.progress = info.ready() ? 1.0 : entry.flight ? entry.flight->watch.fraction() : 0.0;
  return info;
}

Result<TreeInfo> TreeLibrary::Find(const TreeId& id) {
  return Wait(id, SteadyClock::now(), CancelToken());
}

Result<TreeInfo> TreeLibrary::Wait(const TreeId& id, SteadyClock::time_point until,
                                   const CancelToken& cancel) {
  std::shared_ptr<Flight>
      flight;  // its scene may be the last of a large tree; destroyed without the lock
  std::unique_lock lock(mutex_);
  for (;;) {
    Result<Entry*> entry = FindLocked(id);
    if (!entry.ok()) return std::move(entry).error();
    if ((*entry)->record.tree) return InfoOf(**entry);
    if (std::optional<Error> failure = EnsureFlight(*entry)) return *std::move(failure);
    if (SteadyClock::now() >= until || cancel.ShouldStop()) return InfoOf(**entry);
    flight = (*entry)->flight;
    flight->landed.wait_until(lock, std::min(until, SteadyClock::now() + kLookAgain),
                              [&] { return flight->done; });
    if (flight->done && flight->error) return *flight->error;
  }
}

Result<Scene> TreeLibrary::Load(const TreeId& id, const CancelToken& cancel) {
  store_->UseMesh(id.mesh);
  std::shared_ptr<Flight> flight;  // as above
  std::unique_lock lock(mutex_);
  Result<Entry*> entry = FindLocked(id);
  if (!entry.ok()) return std::move(entry).error();
  if (std::optional<Scene> scene = FindInMemory(**entry)) return *std::move(scene);
  if (std::optional<Error> failure = EnsureFlight(*entry)) return *std::move(failure);

  flight = (*entry)->flight;
  while (!flight->done) {
    if (cancel.ShouldStop()) {
      Error error = cancel.ToError();
      if (error.code == ErrorCode::kDeadlineExceeded && flight->watch.waits_for_memory) {
        return Error{ErrorCode::kMemoryFull, "there was no memory for this tree in time"};
      }
      return error;
    }
    flight->landed.wait_until(lock, std::min(cancel.deadline(), SteadyClock::now() + kLookAgain));
  }
  if (flight->error) return *flight->error;
  return *flight->scene;
}

Result<Scene> TreeLibrary::LoadWithBinary(const TreeId& id, const CancelToken& cancel) {
  Result<Scene> scene = Load(id, cancel);
  if (!scene.ok()) return scene;
  Status made = binary_rebuilder_.Ensure(id.mesh, *scene, cancel);
  if (!made.ok()) return std::move(made).error();
  return scene;
}

std::vector<TreeInfo> TreeLibrary::List(const std::optional<Sha256Digest>& mesh,
                                        const std::optional<Position>& after, std::size_t limit) {
  const std::lock_guard lock(mutex_);
  std::vector<TreeInfo> trees;
  auto next = after ? by_age_.upper_bound(*after) : by_age_.begin();
  for (; next != by_age_.end() && trees.size() < limit; ++next) {
    if (mesh && next->id.mesh != *mesh) continue;
    trees.push_back(InfoOf(entries_.at(next->id)));
  }
  return trees;
}

Result<std::unique_ptr<ReadableFile>> TreeLibrary::OpenMesh(const TreeId& id,
                                                            const CancelToken& cancel) {
  {
    const std::lock_guard lock(mutex_);
    const Result<Entry*> entry = FindLocked(id);
    if (!entry.ok()) return entry.error();
  }
  Result<std::unique_ptr<ReadableFile>> file = store_->OpenMesh(id.mesh, cancel);
  if (!file.ok() && file.error().code == ErrorCode::kCorrupt) {
    const std::lock_guard lock(mutex_);
    if (FirstOf(id.mesh) == entries_.end()) return NoSuchTree();  // deleted meanwhile
    damaged_meshes_.insert(id.mesh);
  }
  return file;
}

Status TreeLibrary::Delete(const TreeId& id) {
  const std::lock_guard files_lock(MeshMutex(id.mesh));
  {
    const std::lock_guard lock(mutex_);
    if (failures_.erase(id) != 0) return {};
    if (!entries_.contains(id)) return NoSuchTree();
  }
  // The record first: after a crash only a mesh without a record remains. Later steps cannot fail.
  Error gone = NoSuchTree();
  if (Status status = RemoveRecord(id); !status.ok()) return status;
  ForgetAndRemoveFiles(id, std::move(gone));
  return {};
}

// Removes the record of an existing id; the caller holds its mesh's mutex. After an error the
// record may be missing, but not durably: it is written again, now or when the id is added again.
Status TreeLibrary::RemoveRecord(const TreeId& id) {
  TreeRecord record;
  {
    const std::lock_guard lock(mutex_);
    Entry& entry = entries_.at(id);
    record = entry.record;
    entry.is_in_doubt = true;
  }
  Status removed = store_->RemoveRecord(id);
  if (removed.ok()) return removed;
  const bool is_in_doubt = !store_->SaveRecord(record).ok();
  const std::lock_guard lock(mutex_);
  entries_.at(id).is_in_doubt = is_in_doubt;
  return removed;
}

// Drops a mesh with all its trees, unless work on it has begun meanwhile.
Status TreeLibrary::DropMesh(const Sha256Digest& mesh) {
  const std::lock_guard files_lock(MeshMutex(mesh));
  std::vector<TreeId> ids;
  {
    const std::lock_guard lock(mutex_);
    for (auto entry = FirstOf(mesh); entry != entries_.end() && entry->first.mesh == mesh;
         ++entry) {
      if (entry->second.flight) return {};
      ids.push_back(entry->first);
    }
  }
  for (const TreeId& id : ids) {
    Error gone = NoSuchTree();
    if (Status status = RemoveRecord(id); !status.ok()) return status;
    ForgetAndRemoveFiles(id, std::move(gone));
  }
  // Called again for its status: a mesh that cannot be removed must not be retried for ever.
  return RemoveUnusedMesh(mesh);
}

Status TreeLibrary::DropUnrecordedMesh(const Sha256Digest& mesh) {
  const std::lock_guard files_lock(MeshMutex(mesh));
  return RemoveUnusedMesh(mesh);
}

// The caller holds the mesh's mutex and has removed the record. The id is removed in any case.
void TreeLibrary::ForgetAndRemoveFiles(const TreeId& id, Error error) noexcept {
  std::optional<BuildKind> orphan;
  bool mesh_too = false;
  {
    const std::lock_guard lock(mutex_);
    const auto entry = entries_.find(id);
    if (entry == entries_.end()) return;
    const std::optional<BuildKind> build = BuildOf(entry->second.record);
    if (std::shared_ptr<Flight> flight = entry->second.flight) {
      flight->watch.cancel.Cancel();
      Land(&entry->second, std::move(error));
    }
    by_age_.erase({entry->second.record.created_ms, id});
    entries_.erase(entry);
    mesh_too = !HasMesh(id.mesh);
    if (build && !IsWanted(id.mesh, *build)) orphan = build;
    if (mesh_too) damaged_meshes_.erase(id.mesh);
  }
  if (mesh_too) {
    measurements_.Forget(id.mesh);
    cache_.EraseMesh(id.mesh);
  } else if (orphan) {
    cache_.EraseTree(id.mesh, *orphan);
  }
  try {
    // If the disk fails, the mesh file remains without a record.
    if (mesh_too) {
      (void)RemoveUnusedMesh(id.mesh);
    } else if (orphan) {
      store_->RemoveTree(id.mesh, *orphan);
    }
  } catch (...) {
    // No memory for the names of the files: they stay, as after a failure of the disk.
  }
}

// A mesh without trees: its last one was deleted, or an upload failed before its record. The caller
// holds the mesh's mutex. Records that a failed write may have left are removed before the file, so
// no start finds a record without its mesh.
Status TreeLibrary::RemoveUnusedMesh(const Sha256Digest& mesh) {
  {
    const std::lock_guard lock(mutex_);
    if (HasMesh(mesh)) return {};
  }
  if (Status status = store_->RemoveRecordsOf(mesh); !status.ok()) {
    store_->MarkUnrecorded(mesh);
    return status;
  }
  return store_->RemoveMesh(mesh);
}

TreeLibrary::Entries::iterator TreeLibrary::FirstOf(const Sha256Digest& mesh) {
  // An id without a build sorts before those with one.
  const auto first = entries_.lower_bound(TreeId{mesh, std::nullopt});
  return first != entries_.end() && first->first.mesh == mesh ? first : entries_.end();
}

bool TreeLibrary::HasMesh(const Sha256Digest& mesh) { return FirstOf(mesh) != entries_.end(); }

bool TreeLibrary::IsWanted(const Sha256Digest& mesh, BuildKind build) {
  for (auto entry = FirstOf(mesh); entry != entries_.end() && entry->first.mesh == mesh; ++entry) {
    if (BuildOf(entry->second.record) == build) return true;
  }
  return false;
}

std::optional<BuildKind> TreeLibrary::BuildOf(const TreeRecord& record) {
  if (record.id.build) return record.id.build;
  if (!record.mesh) return std::nullopt;
  return AutoBuildKind(static_cast<std::size_t>(record.mesh->triangles));
}

LibraryCounters TreeLibrary::counters() const {
  LibraryCounters counters;
  counters.parses = source_.parses();
  counters.builds = source_.builds();
  counters.loads = source_.loads();
  counters.binary_rebuilds = binary_rebuilder_.rebuilds();
  counters.damaged_files = store_->damaged_files();
  counters.evictions = cache_.evictions();
  counters.memory_bytes = budget_.used();
  counters.store_bytes = store_->bytes();
  counters.unrecorded_meshes = store_->unrecorded_meshes();
  const std::lock_guard lock(mutex_);
  counters.unreadable_meshes = damaged_meshes_.size();
  counters.rebuilds = rebuilds_;
  counters.trees = entries_.size();
  return counters;
}

}  // namespace kdray::core
