// The worker's side of TreeLibrary: flights from start to end.
#include <array>
#include <map>
#include <new>
#include <utility>

#include "core/library/flight.h"
#include "core/library/tree_library.h"

namespace kdray::core {
namespace {

using SteadyClock = std::chrono::steady_clock;

// Bounds the failures of deleted ids, which are kept for their answer, against a flood of invalid
// meshes.
constexpr std::size_t kMaxFailures = 10'000;
// How long files that are being written when the library shuts down may still take.
constexpr std::chrono::milliseconds kTimeToStore{100};

// The same bytes would fail the same way.
bool IsMeshsFault(ErrorCode code) {
  return code == ErrorCode::kInvalidMesh || code == ErrorCode::kEmptyMesh ||
         code == ErrorCode::kUnsupportedMeshFormat;
}

WorkQueue::Lane LaneOf(const TreeRecord& record) {
  return record.tree ? WorkQueue::Lane::kLoad : WorkQueue::Lane::kBuild;
}

Error ShuttingDown() { return Error{ErrorCode::kCancelled, "shutting down"}; }

}  // namespace

std::optional<Scene> TreeLibrary::FindInMemory(const Entry& entry) {
  if (!entry.record.tree) return std::nullopt;
  const TreeCache::TreePointer tree =
      cache_.FindTree(entry.record.id.mesh, entry.record.tree->build);
  if (tree == nullptr) return std::nullopt;
  const TreeCache::MeshPointer mesh = cache_.FindMesh(entry.record.id.mesh);
  if (mesh == nullptr) return std::nullopt;
  return Scene{std::shared_ptr<const TriangleMesh>(mesh, &mesh->mesh), tree};
}

std::optional<Error> TreeLibrary::EnsureFlight(Entry* entry) {
  if (entry->flight) {
    entry->flight->is_asked_for = true;
    return std::nullopt;
  }
  if (entry->failure) {
    if (SteadyClock::now() < entry->failure->until) return entry->failure->error;
    entry->failure.reset();
  }
  if (shut_down_) return ShuttingDown();
  StartFlight(entry, MemoryCharge());
  return std::nullopt;
}

// Submits the job first: a flight without a job would be waited for for ever. The job waits for
// mutex_.
void TreeLibrary::StartFlight(Entry* entry, MemoryCharge pledge, bool is_resumed) {
  if (shut_down_) return;
  const TreeRecord& record = entry->record;
  auto flight = std::make_shared<Flight>(record.id, std::move(pledge));
  flight->is_resumed = is_resumed;
  flight->is_asked_for = !is_resumed;
  queue_.Submit(record.id.mesh, LaneOf(record), [this, flight] { Fly(flight); });
  entry->flight = std::move(flight);
}

void TreeLibrary::Land(Entry* entry, std::optional<Error> error) noexcept {
  Flight& flight = *entry->flight;
  flight.done = true;
  flight.error = std::move(error);
  flight.pledge = MemoryCharge();
  flight.landed.notify_all();
  entry->flight.reset();
}

// Null if the flight has landed: its tree was deleted, or the library shuts down.
TreeLibrary::Entry* TreeLibrary::EntryOf(const Flight& flight) {
  const auto found = entries_.find(flight.id);
  return found != entries_.end() && found->second.flight.get() == &flight ? &found->second
                                                                          : nullptr;
}

void TreeLibrary::Fly(const std::shared_ptr<Flight>& flight) noexcept {
  // These messages are short enough to need no memory.
  try {
    FlyNow(flight);
  } catch (const std::bad_alloc&) {
    GiveUp(flight.get(), Error{ErrorCode::kMemoryFull, "out of memory"});
  } catch (...) {
    GiveUp(flight.get(), Error{ErrorCode::kInternal, "a failure"});
  }
  EraseUnwanted(flight->id.mesh);
}

// Erases items that a deletion missed because they were being loaded.
void TreeLibrary::EraseUnwanted(const Sha256Digest& mesh) noexcept {
  const std::lock_guard files_lock(MeshMutex(mesh));
  bool mesh_is_wanted = false;
  std::array<bool, kAllBuildKinds.size()> is_wanted{};
  {
    const std::lock_guard lock(mutex_);
    mesh_is_wanted = HasMesh(mesh);
    for (std::size_t i = 0; i < is_wanted.size(); ++i) {
      is_wanted[i] = IsWanted(mesh, kAllBuildKinds[i]);
    }
  }
  // Without mutex_, because destroying a large tree takes long.
  if (!mesh_is_wanted) cache_.EraseMesh(mesh);
  for (std::size_t i = 0; i < is_wanted.size(); ++i) {
    if (!is_wanted[i]) cache_.EraseTree(mesh, kAllBuildKinds[i]);
  }
}

// Notes on disk that this start resumes the build, before it does: should it end the process, the
// next start knows. False when there is nothing to do: the tree is gone, or the disk does not take
// the note and nobody has asked for the tree.
bool TreeLibrary::CountResume(Flight* flight) {
  const std::lock_guard files_lock(MeshMutex(flight->id.mesh));
  TreeRecord record;
  {
    const std::lock_guard lock(mutex_);
    const Entry* entry = EntryOf(*flight);
    if (entry == nullptr) return false;
    record = entry->record;
  }
  ++record.resumed;
  const bool is_noted = store_->SaveRecord(record).ok();
  const std::lock_guard lock(mutex_);
  Entry* entry = EntryOf(*flight);
  if (entry == nullptr) return false;
  if (is_noted) {
    entry->record.resumed = record.resumed;
    flight->is_counted = true;
  } else if (!flight->is_asked_for) {
    Land(entry, std::nullopt);  // nobody waits for it
    return false;
  }
  return true;
}

// After CountResume, when the library shuts down before the build has ended.
void TreeLibrary::UncountResume(const TreeId& id) {
  const std::lock_guard files_lock(MeshMutex(id.mesh));
  TreeRecord record;
  {
    const std::lock_guard lock(mutex_);
    const auto found = entries_.find(id);
    if (!shut_down_ || found == entries_.end()) return;
    record = found->second.record;
  }
  if (record.tree || record.resumed == 0) return;
  --record.resumed;
  (void)store_->SaveRecord(record);
}

void TreeLibrary::FlyNow(const std::shared_ptr<Flight>& flight) {
  if (flight->is_resumed && !CountResume(flight.get())) return;
  TreeRecord record;
  {
    const std::lock_guard lock(mutex_);
    const Entry* entry = EntryOf(*flight);
    if (entry == nullptr) return;
    record = entry->record;
  }
  const SceneSource::Hooks hooks{.on_mesh =
                                     [&](const MeshFacts& facts) {
                                       const std::lock_guard lock(mutex_);
                                       if (Entry* entry = EntryOf(*flight))
                                         entry->record.mesh = facts;
                                     },
                                 .step_aside = [&] { return queue_.StepAside(LaneOf(record)); }};
  const Result<SceneSource::Fetched> fetched = source_.Fetch(record, &flight->watch, hooks);
  if (fetched.ok()) {
    if (Succeed(flight.get(), *fetched)) Persist(record, *fetched);
  } else {
    Fail(flight.get(), fetched.error());
  }
  if (flight->is_counted) UncountResume(flight->id);
}

// The error's copy must not allocate. No effect on a flight that has landed.
void TreeLibrary::GiveUp(Flight* flight, Error error) noexcept {
  const std::lock_guard lock(mutex_);
  Entry* entry = EntryOf(*flight);
  if (entry == nullptr) return;
  entry->failure = Failure{error, SteadyClock::now() + options_.retry_after};
  Land(entry, std::move(error));
}

bool TreeLibrary::Succeed(Flight* flight, const SceneSource::Fetched& fetched) {
  const std::lock_guard lock(mutex_);
  Entry* entry = EntryOf(*flight);
  if (entry == nullptr) return false;
  TreeRecord& record = entry->record;
  TreeFacts facts = fetched.tree;  // allocations come first
  std::optional<MeshFacts> mesh_facts = fetched.prepared->facts;
  if (!fetched.was_built && !record.tree) {
    // The tree exists under another id, which has its build time.
    for (auto other = FirstOf(record.id.mesh);
         other != entries_.end() && other->first.mesh == record.id.mesh; ++other) {
      const std::optional<TreeFacts>& tree = other->second.record.tree;
      if (tree && tree->build == facts.build) facts.build_ms = tree->build_ms;
    }
  }
  if (record.tree && fetched.was_built) ++rebuilds_;
  record.resumed = 0;
  record.mesh = std::move(mesh_facts);
  record.tree = std::move(facts);
  entry->failure.reset();
  flight->scene = fetched.scene;
  Land(entry, std::nullopt);
  return true;
}

// Waiting requests are answered before this; a crash meanwhile costs a build, not an answer.
void TreeLibrary::Persist(const TreeRecord& before, const SceneSource::Fetched& fetched) {
  const TreeId& id = before.id;
  source_.Store(id, fetched, CancelToken::When([this, &id, build = fetched.tree.build] {
                  return !MayStore(id.mesh, build);
                }));
  const std::lock_guard files_lock(MeshMutex(id.mesh));
  std::optional<TreeRecord> record;
  bool mesh_is_wanted = false;
  bool tree_is_wanted = false;
  {
    const std::lock_guard lock(mutex_);
    if (const auto found = entries_.find(id); found != entries_.end()) {
      record = found->second.record;
    }
    mesh_is_wanted = HasMesh(id.mesh);
    tree_is_wanted = IsWanted(id.mesh, fetched.tree.build);
  }
  // Deleted while it was written: removes the written files.
  if (!mesh_is_wanted) {
    cache_.EraseMesh(id.mesh);
    (void)RemoveUnusedMesh(id.mesh);
  } else if (!tree_is_wanted) {
    cache_.EraseTree(id.mesh, fetched.tree.build);
    store_->RemoveTree(id.mesh, fetched.tree.build);
  }
  // If the record cannot be written, the stored one says that a build is due; the tree's file will
  // be read instead.
  if (!record || *record == before || !store_->SaveRecord(*record).ok()) return;
  const std::lock_guard lock(mutex_);
  entries_.at(id).is_in_doubt = false;
}

// Whether the files of a tree are still wanted while they are written. After Shutdown a small file
// gets the time that it takes; without it the next start would parse or build again.
bool TreeLibrary::MayStore(const Sha256Digest& mesh, BuildKind build) {
  const std::lock_guard lock(mutex_);
  if (shut_down_ && SteadyClock::now() > store_until_) return false;
  return IsWanted(mesh, build);
}

void TreeLibrary::Fail(Flight* flight, const Error& error) {
  const TreeId& id = flight->id;
  const std::lock_guard files_lock(MeshMutex(id.mesh));
  bool for_good = false;
  {
    const std::lock_guard lock(mutex_);
    const Entry* entry = EntryOf(*flight);
    if (entry == nullptr) return;
    const bool was_ready = entry->record.tree.has_value();
    for_good = !was_ready && (IsMeshsFault(error.code) ||
                              (error.code == ErrorCode::kMeshTooLarge && entry->is_new));
    if (error.code == ErrorCode::kCorrupt) damaged_meshes_.insert(id.mesh);
  }
  // Allocations come first.
  const SteadyClock::time_point now = SteadyClock::now();
  Error told = error;
  std::map<TreeId, Failure> kept;
  kept[id] = Failure{error, now + options_.keep_failure};
  Failure passing{error, now + (for_good ? options_.keep_failure : options_.retry_after)};
  // If the record cannot be removed, its mesh stays, and the tree has the failure.
  const bool is_gone = for_good && RemoveRecord(id).ok();
  {
    const std::lock_guard lock(mutex_);
    if (is_gone) {
      MakeWayForFailure();
      failures_.erase(id);
      failures_.insert(kept.extract(kept.begin()));
    } else if (Entry* entry = EntryOf(*flight)) {
      entry->failure = std::move(passing);
      Land(entry, std::move(told));
    }
  }
  if (is_gone) ForgetAndRemoveFiles(id, std::move(told));
}

// With mutex_ held.
void TreeLibrary::MakeWayForFailure() {
  if (failures_.size() < kMaxFailures) return;
  const SteadyClock::time_point now = SteadyClock::now();
  std::erase_if(failures_, [&](const auto& failure) { return failure.second.until <= now; });
  if (failures_.size() >= kMaxFailures) failures_.erase(failures_.begin());
}

void TreeLibrary::Shutdown() {
  {
    const std::lock_guard lock(mutex_);
    shut_down_ = true;
    store_until_ = SteadyClock::now() + kTimeToStore;
    for (auto& [id, entry] : entries_) {
      if (!entry.flight) continue;
      entry.flight->watch.cancel.Cancel();
      Land(&entry, ShuttingDown());
    }
  }
  measurements_.Stop();
  binary_rebuilder_.Stop();
  queue_.Stop();
}

}  // namespace kdray::core
