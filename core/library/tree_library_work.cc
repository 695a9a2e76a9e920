// The worker's side of TreeLibrary: flights from start to landing.
#include <exception>
#include <utility>

#include "core/library/flight.h"
#include "core/library/tree_library.h"

namespace kdray::core {
namespace {

using SteadyClock = std::chrono::steady_clock;

// Failures of ids that are gone are kept for their answer; a flood of broken meshes must not turn
// them into a leak.
constexpr std::size_t kMaxFailures = 10'000;

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
  if (entry->flight) return std::nullopt;
  if (entry->failure) {
    if (SteadyClock::now() < entry->failure->until) return entry->failure->error;
    entry->failure.reset();
  }
  if (shut_down_) return ShuttingDown();
  StartFlight(entry, MemoryCharge());
  return std::nullopt;
}

void TreeLibrary::StartFlight(Entry* entry, MemoryCharge pledge) {
  if (shut_down_) return;
  const TreeRecord& record = entry->record;
  entry->flight = std::make_shared<Flight>(record.id, std::move(pledge));
  queue_.Submit(record.id.mesh, LaneOf(record), [this, flight = entry->flight] { Fly(flight); });
}

void TreeLibrary::Land(Entry* entry, std::optional<Error> error) {
  Flight& flight = *entry->flight;
  flight.done = true;
  flight.error = std::move(error);
  flight.pledge = MemoryCharge();
  flight.landed.notify_all();
  entry->flight.reset();
}

// Null once the flight has landed: its tree was deleted, or the library shuts down.
TreeLibrary::Entry* TreeLibrary::EntryOf(const Flight& flight) {
  const auto found = entries_.find(flight.id);
  return found != entries_.end() && found->second.flight.get() == &flight ? &found->second
                                                                          : nullptr;
}

void TreeLibrary::Fly(const std::shared_ptr<Flight>& flight) {
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
  try {
    const Result<SceneSource::Fetched> fetched = source_.Fetch(record, &flight->watch, hooks);
    if (fetched.ok()) {
      if (Succeed(flight.get(), *fetched)) Persist(record, *fetched);
    } else {
      Fail(flight.get(), fetched.error());
    }
  } catch (const std::exception&) {
    Fail(flight.get(), Error{ErrorCode::kInternal, "an unexpected failure"});
  }
}

bool TreeLibrary::Succeed(Flight* flight, const SceneSource::Fetched& fetched) {
  const std::lock_guard lock(mutex_);
  Entry* entry = EntryOf(*flight);
  if (entry == nullptr) return false;
  TreeRecord& record = entry->record;
  if (record.tree && fetched.was_built) ++rebuilds_;
  TreeFacts facts = fetched.tree;
  if (!fetched.was_built && !record.tree) {
    // The tree was there under another id; its build time is told there.
    for (auto other = FirstOf(record.id.mesh);
         other != entries_.end() && other->first.mesh == record.id.mesh; ++other) {
      const std::optional<TreeFacts>& tree = other->second.record.tree;
      if (tree && tree->build == facts.build) facts.build_ms = tree->build_ms;
    }
  }
  record.mesh = fetched.prepared->facts;
  record.tree = std::move(facts);
  entry->failure.reset();
  flight->scene = fetched.scene;
  Land(entry, std::nullopt);
  return true;
}

// Those who wait are answered before; a crash meanwhile costs a build, not an answer.
void TreeLibrary::Persist(const TreeRecord& before, const SceneSource::Fetched& fetched) {
  source_.Store(before.id, fetched);
  const TreeId& id = before.id;
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
  // Deleted while it was written: what was written goes as well.
  if (!mesh_is_wanted) {
    cache_.EraseMesh(id.mesh);
    (void)RemoveUnusedMesh(id.mesh);
  } else if (!tree_is_wanted) {
    cache_.EraseTree(id.mesh, fetched.tree.build);
    store_->RemoveTree(id.mesh, fetched.tree.build);
  }
  // A record that cannot be written now says that a build is due; the tree's file answers that.
  if (!record || *record == before || !store_->SaveRecord(*record).ok()) return;
  const std::lock_guard lock(mutex_);
  entries_.at(id).is_in_doubt = false;
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
  // A record that the disk does not let go keeps its mesh, and the failure is the tree's.
  const bool is_gone = for_good && RemoveRecord(id).ok();
  {
    const std::lock_guard lock(mutex_);
    if (is_gone) {
      KeepFailure(id, error);
    } else if (Entry* entry = EntryOf(*flight)) {
      const auto time = for_good ? options_.keep_failure : options_.retry_after;
      entry->failure = Failure{error, SteadyClock::now() + time};
      Land(entry, error);
    }
  }
  if (is_gone) ForgetAndRemoveFiles(id, error);
}

void TreeLibrary::KeepFailure(const TreeId& id, const Error& error) {
  const SteadyClock::time_point now = SteadyClock::now();
  if (failures_.size() >= kMaxFailures) {
    std::erase_if(failures_, [&](const auto& failure) { return failure.second.until <= now; });
  }
  if (failures_.size() >= kMaxFailures) failures_.erase(failures_.begin());
  failures_[id] = Failure{error, now + options_.keep_failure};
}

void TreeLibrary::Shutdown() {
  {
    const std::lock_guard lock(mutex_);
    shut_down_ = true;
    for (auto& [id, entry] : entries_) {
      if (!entry.flight) continue;
      entry.flight->watch.cancel.Cancel();
      Land(&entry, ShuttingDown());
    }
  }
  measurements_.Stop();
  queue_.Stop();
}

}  // namespace kdray::core
