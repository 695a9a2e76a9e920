// SPDX-License-Identifier: Apache-2.0
#include "core/library/shared_trees.h"

#include <algorithm>
#include <new>
#include <utility>

namespace kdray::core {
namespace {

// Requests to a store mostly wait.
constexpr int kLookupThreads = 8;
constexpr int kTransferThreads = 2;

// Poll interval; a CancelToken has no notification.
constexpr std::chrono::milliseconds kLookAgain{50};
// The age of a question for which a request for a known tree waits no longer.
constexpr std::chrono::milliseconds kPatience{1000};

Error NoSuchTree() { return Error{ErrorCode::kNotFound, "no tree has this id"}; }
}  // namespace

SharedTrees::SharedTrees(const SharedTreesOptions& options, Parts parts)
    : confirm_every_(options.confirm_every),
      parts_(std::move(parts)),
      counting_(options.store),
      objects_(&counting_, options.retries, options.on_change),
      shared_(&objects_),
      lookup_queue_(0, kLookupThreads, 0),
      transfer_queue_(0, kTransferThreads, 0) {}

SharedTrees::~SharedTrees() { Stop(); }

void SharedTrees::Stop() {
  stop_.Cancel();
  lookup_queue_.Stop();
  transfer_queue_.Stop();
  // Lookups that were dropped end too.
  const std::lock_guard lock(mutex_);
  for (const auto& [id, lookup] : lookups_) {
    lookup->has_ended = true;
    lookup->status = Error{ErrorCode::kCancelled, "shutting down"};
  }
  lookups_.clear();
  changed_.notify_all();
}

Status SharedTrees::CheckAtStart() {
  Status status = shared_.Check(stop_);
  if (!status.ok() && IsStoreAway(status.error())) return {};
  return status;
}

Status SharedTrees::CheckThere() const {
  if (objects_.IsAway()) return StoreIsAway("the store does not answer; it is asked again soon");
  return {};
}

SharedTrees::Counts SharedTrees::counts() const {
  Counts counts;
  {
    const std::lock_guard lock(mutex_);
    counts = counts_;
  }
  counts.requests = counting_.counts();
  counts.retries = objects_.counts();
  return counts;
}

Error SharedTrees::Unanswered(const Error& error) {
  const bool says_it_itself = IsStoreAway(error) || error.code == ErrorCode::kCancelled ||
                              error.code == ErrorCode::kDeadlineExceeded ||
                              error.code == ErrorCode::kMemoryFull;
  return says_it_itself ? error : StoreIsAway(error.message);
}

Status SharedTrees::Ensure(const TreeId& id, const CancelToken& cancel) {
  const Status known = parts_.registry->Check(id);
  // A build that failed here fails again, wherever its mesh comes from.
  if (!known.ok() && known.error().code != ErrorCode::kNotFound) return {};
  if (known.ok() && objects_.IsAway()) return {};
  const Clock::time_point asked = Clock::now();
  std::unique_lock lock(mutex_);
  for (;;) {
    const auto found = confirmed_.find(id);
    if (known.ok() && found != confirmed_.end() && found->second + confirm_every_ > asked) {
      // Ahead of time, so a tree in use is confirmed while nobody waits.
      if (found->second + confirm_every_ / 2 <= asked) (void)Begin(id);
      return {};
    }
    const std::shared_ptr<Lookup> lookup = Begin(id);
    while (!lookup->has_ended) {
      if (cancel.ShouldStop()) return cancel.ToError();
      if (known.ok() && Clock::now() >= lookup->started + kPatience) return {};
      changed_.wait_until(lock, std::min(cancel.deadline(), Clock::now() + kLookAgain));
    }
    const Status& status = lookup->status;
    // One that began long before this request may have missed a deletion.
    if (status.ok() && lookup->started + confirm_every_ <= asked && lookup->started < asked) {
      continue;
    }
    if (status.ok() || status.error().code == ErrorCode::kNotFound) return status;
    if (known.ok() && status.error().code != ErrorCode::kCancelled) return {};
    return Unanswered(status.error());
  }
}

std::shared_ptr<SharedTrees::Lookup> SharedTrees::Begin(const TreeId& id) {
  const auto [place, is_new] = lookups_.try_emplace(id);
  if (!is_new) return place->second;
  auto lookup = std::make_shared<Lookup>();
  if (stop_.ShouldStop()) {
    lookups_.erase(place);
    lookup->has_ended = true;
    lookup->status = Error{ErrorCode::kCancelled, "shutting down"};
    return lookup;
  }
  try {
    lookup_queue_.Submit(id.mesh, WorkQueue::Lane::kBuild, [this, id, lookup] { Run(id, lookup); });
  } catch (...) {
    lookups_.erase(place);
    throw;
  }
  place->second = lookup;
  ++counts_.lookups;
  return lookup;
}

void SharedTrees::Run(const TreeId& id, const std::shared_ptr<Lookup>& lookup) noexcept {
  // These messages are short enough to need no memory.
  Status status = Error{ErrorCode::kInternal, "a failure"};
  try {
    status = Ask(id, lookup->started);
  } catch (const std::bad_alloc&) {
    status = Error{ErrorCode::kMemoryFull, "out of memory"};
  } catch (...) {
  }
  const std::lock_guard lock(mutex_);
  lookup->has_ended = true;
  lookup->status = std::move(status);
  lookups_.erase(id);
  changed_.notify_all();
}

Status SharedTrees::Ask(const TreeId& id, Clock::time_point started) {
  if (parts_.registry->FindRecord(id)) {
    const Result<bool> exists = shared_.Exists(id, stop_);
    if (!exists.ok()) return exists.error();
    if (*exists) {
      Confirm(id, started);
      return {};
    }
  } else {
    const Result<std::optional<SharedStore::Found>> found = shared_.Find(id, stop_);
    if (!found.ok()) return found.error();
    if (*found) {
      Adopt(**found);
      Confirm(id, started);
      return {};
    }
  }
  RemoveHere(id, started);
  return NoSuchTree();
}

// A record on disk promises the mesh on disk, so it is written when the mesh is there.
void SharedTrees::Adopt(const SharedStore::Found& found) {
  const TreeRecord& record = found.record;
  TreeRegistry::NewTree tree(record);
  const std::lock_guard files_lock(parts_.mesh_locks->Of(record.id.mesh));
  // Known, or its build has just failed here for good, and the store is about to learn of it.
  const Status known = parts_.registry->Check(record.id);
  if (known.ok() || known.error().code != ErrorCode::kNotFound) return;
  const bool is_mesh_here = parts_.registry->HasSoundMesh(record.id.mesh) &&
                            parts_.store->HasMesh(record.id.mesh, record.mesh_bytes);
  if (is_mesh_here) (void)parts_.store->SaveRecord(record);
  parts_.registry->AddKnown(std::move(tree));
}

void SharedTrees::Confirm(const TreeId& id, Clock::time_point seen) {
  const std::lock_guard lock(mutex_);
  Clock::time_point& confirmed = confirmed_.try_emplace(id, Clock::time_point::min()).first->second;
  confirmed = std::max(confirmed, seen);
  if (confirmed_.size() < prune_at_) return;
  // Old entries say nothing; some of them are of trees that were evicted.
  std::erase_if(confirmed_, [old = Clock::now() - confirm_every_](const auto& entry) {
    return entry.second <= old;
  });
  prune_at_ = std::max<std::size_t>(1024, 2 * confirmed_.size());
}

// The store said no after `asked`. An upload may have been acknowledged since.
void SharedTrees::RemoveHere(const TreeId& id, Clock::time_point asked) {
  const std::lock_guard files_lock(parts_.mesh_locks->Of(id.mesh));
  {
    const std::lock_guard lock(mutex_);
    const auto found = confirmed_.find(id);
    if (found != confirmed_.end()) {
      if (found->second > asked) return;
      confirmed_.erase(found);
    }
  }
  (void)parts_.remover->Remove(id, NoSuchTree());
}

Status SharedTrees::Meet(const Sha256Digest& mesh, const CancelToken& cancel) {
  const Result<std::vector<TreeId>> ids = shared_.IdsOf(mesh, cancel);
  if (!ids.ok()) return Unanswered(ids.error());
  for (const TreeId& id : *ids) {
    Status status = Ensure(id, cancel);
    if (!status.ok() && status.error().code != ErrorCode::kNotFound) return status;
    if (parts_.registry->HasMesh(mesh)) return {};
  }
  return NoSuchTree();
}

// Changes.

Result<SharedStore::Published> SharedTrees::Publish(const TreeId& id, const ReadableFile& mesh) {
  Result<Buffer> buffer = MakeBuffer(mesh.size());
  if (!buffer.ok()) return std::move(buffer).error();
  TreeRecord record;
  record.id = id;
  record.mesh_bytes = mesh.size();
  return shared_.Publish(std::move(record), mesh, buffer->bytes, stop_);
}

Result<bool> SharedTrees::Remove(const TreeId& id) { return shared_.Remove(id, stop_); }

void SharedTrees::RemoveLater(const TreeId& id) noexcept {
  SubmitTransfer(id.mesh, [this, id] { (void)shared_.Remove(id, stop_); });
}

void SharedTrees::StoreLater(const TreeRecord& record, BuildKind build) noexcept {
  SubmitTransfer(record.id.mesh, [this, record, build] { Store(record, build); });
}

void SharedTrees::SubmitTransfer(const Sha256Digest& mesh, std::function<void()> job) noexcept {
  try {
    transfer_queue_.Submit(mesh, WorkQueue::Lane::kBuild, [job = std::move(job)] {
      try {
        job();
      } catch (...) {
        // No memory: as if the store had failed.
      }
    });
  } catch (...) {
  }
}

void SharedTrees::Store(const TreeRecord& record, BuildKind build) {
  const Sha256Digest& mesh = record.id.mesh;
  const Result<bool> exists = shared_.Update(record, stop_);
  if (!exists.ok() || !*exists) return;
  const auto file = parts_.store->OpenTree(mesh, build);
  if (!file.ok()) return;  // there was no room for it, or it was deleted
  Result<Buffer> buffer = MakeBuffer((*file)->size());
  if (!buffer.ok()) return;
  (void)shared_.PutTree(mesh, build, **file, buffer->bytes, stop_);
  shared_.CleanTrees(mesh, stop_);  // it may have been deleted meanwhile
}

}  // namespace kdray::core
