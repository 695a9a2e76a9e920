// SPDX-License-Identifier: Apache-2.0
#include "core/library/tree_library.h"

#include <utility>

namespace kdray::core {
namespace {

using SteadyClock = std::chrono::steady_clock;

Error NoSuchTree() { return Error{ErrorCode::kNotFound, "no tree has this id"}; }

}  // namespace

// Tasks start in Open, after the constructor, and are stopped by Shutdown, before the destructor
// of any member.
TreeLibrary::TreeLibrary(const LibraryOptions& options, std::unique_ptr<SceneStore> store)
    : store_(std::move(store)),
      budget_(options.memory_limit_bytes),
      arena_(options.build_threads),
      registry_({.keep_failure = options.keep_failure, .retry_after = options.retry_after},
                [this](const std::shared_ptr<TreeTask>& task) { builder_.Start(task); }),
      loader_(store_.get(), &cache_, &budget_, &arena_),
      remover_(&registry_, store_.get(), &cache_, &measurements_),
      shared_(options.shared.store == nullptr
                  ? nullptr
                  : std::make_unique<SharedTrees>(
                        options.shared,
                        SharedTrees::Parts{
                            &registry_, &remover_, store_.get(), &cache_, &mesh_locks_, &budget_,
                            [this](std::uint64_t bytes) { return intake_.MakeRoom(bytes); }})),
      intake_({&registry_, &remover_, store_.get(), &mesh_locks_, &budget_, shared_.get()}),
      binary_rebuilder_(&budget_, &arena_),
      attribute_loader_({store_.get(), &cache_, &budget_,
                         [this](const Sha256Digest& mesh) {
                           const std::lock_guard files_lock(mesh_locks_.Of(mesh));
                           remover_.EvictUnwanted(mesh);
                         }}),
      queue_(kLoadThreads, kBuildThreads, kAsideThreads),
      builder_(
          {&registry_, &remover_, &loader_, store_.get(), &mesh_locks_, &queue_, shared_.get()}),
      measurer_(
          {&registry_, &measurements_, store_.get(), &mesh_locks_, &queue_, &budget_, &arena_,
           [this](const TreeId& id, const CancelToken& cancel) { return Load(id, cancel); }}) {
  budget_.set_reclaim([this](std::uint64_t bytes) { return cache_.EvictIdleIfEnough(bytes); });
}

Result<std::unique_ptr<TreeLibrary>> TreeLibrary::Open(const LibraryOptions& options) {
  FileSystem* file_system =
      options.file_system != nullptr ? options.file_system : &PosixFileSystem();
  Result<std::unique_ptr<SceneStore>> store =
      SceneStore::Open({file_system, options.data_dir, options.store_limit_bytes,
                        options.shared.store != nullptr ? options.shared.name : std::string()});
  if (!store.ok()) return std::move(store).error();
  Result<SceneStore::Contents> contents = (*store)->Load();
  if (!contents.ok()) return std::move(contents).error();
  std::unique_ptr<TreeLibrary> library(new TreeLibrary(options, *std::move(store)));
  if (library->shared_ != nullptr) {
    if (Status status = library->shared_->CheckAtStart(); !status.ok()) {
      return std::move(status).error();
    }
  }
  library->registry_.Adopt(std::move(contents->records), std::move(contents->unreadable_meshes));
  return library;
}

TreeLibrary::~TreeLibrary() { Shutdown(); }

void TreeLibrary::Shutdown() {
  registry_.Shutdown();
  measurements_.Stop();
  binary_rebuilder_.Stop();
  attribute_loader_.Stop();
  if (shared_ != nullptr) shared_->Stop();
  queue_.Stop();
}

Result<TreeLibrary::Upload> TreeLibrary::BeginUpload(std::uint64_t bytes) {
  return intake_.BeginUpload(bytes);
}

Result<TreeLibrary::Added> TreeLibrary::Finish(Upload upload, std::optional<BuildKind> build) {
  return intake_.Finish(std::move(upload), build);
}

Result<TreeLibrary::Added> TreeLibrary::AddBuild(const Sha256Digest& mesh,
                                                 std::optional<BuildKind> build) {
  return intake_.AddBuild(mesh, build);
}

Status TreeLibrary::Ensure(const TreeId& id, const CancelToken& cancel) {
  return shared_ == nullptr ? Status() : shared_->Ensure(id, cancel);
}

Result<TreeInfo> TreeLibrary::Find(const TreeId& id) {
  return Wait(id, SteadyClock::now(), CancelToken());
}

Result<TreeInfo> TreeLibrary::Wait(const TreeId& id, SteadyClock::time_point until,
                                   const CancelToken& cancel) {
  if (Status status = Ensure(id, cancel); !status.ok()) return std::move(status).error();
  for (;;) {
    const Result<std::shared_ptr<TreeTask>> task = registry_.Ask(id, TreeRegistry::Need::kReady);
    if (!task.ok()) return task.error();
    if (*task == nullptr || !(*task)->Wait(until, cancel)) return registry_.Info(id);
    if ((*task)->error()) return *(*task)->error();
  }
}

Result<Scene> TreeLibrary::Load(const TreeId& id, const CancelToken& cancel) {
  if (Status status = Ensure(id, cancel); !status.ok()) return std::move(status).error();
  store_->UseMesh(id.mesh);
  const Result<std::optional<BuildKind>> build = registry_.ReadyBuild(id);
  if (!build.ok()) return build.error();
  if (*build) {
    if (std::optional<Scene> scene = FindInMemory(id.mesh, **build)) {
      cache_hits_.fetch_add(1, std::memory_order_relaxed);
      return *std::move(scene);
    }
  }
  const Result<std::shared_ptr<TreeTask>> asked = registry_.Ask(id, TreeRegistry::Need::kInMemory);
  if (!asked.ok()) return asked.error();
  const TreeTask& task = **asked;
  if (!task.Wait(SteadyClock::time_point::max(), cancel)) {
    Error error = cancel.ToError();
    if (error.code == ErrorCode::kDeadlineExceeded && task.watch.waits_for_memory) {
      return Error{ErrorCode::kMemoryFull, "there was no memory for this tree in time"};
    }
    return error;
  }
  if (task.error()) return *task.error();
  return *task.scene();
}

std::optional<Scene> TreeLibrary::FindInMemory(const Sha256Digest& mesh, BuildKind build) {
  TreeCache::TreePointer tree = cache_.FindTree(mesh, build);
  if (tree == nullptr) return std::nullopt;
  const TreeCache::MeshPointer parsed = cache_.FindMesh(mesh);
  if (parsed == nullptr) return std::nullopt;
  return Scene{std::shared_ptr<const TriangleMesh>(parsed, &parsed->mesh), std::move(tree),
               parsed->facts.health.closed};
}

Result<Scene> TreeLibrary::LoadWithBinary(const TreeId& id, const CancelToken& cancel) {
  Result<Scene> scene = Load(id, cancel);
  if (!scene.ok()) return scene;
  Status made = binary_rebuilder_.Ensure(id.mesh, *scene, cancel);
  if (!made.ok()) return std::move(made).error();
  return scene;
}

Result<std::shared_ptr<const MeshAttributes>> TreeLibrary::LoadAttributes(
    const TreeId& id, AttributeKinds kinds, const CancelToken& cancel) {
  if (Status status = CheckMesh(id, cancel); !status.ok()) return std::move(status).error();
  const std::optional<TreeRegistry::MeshInfo> mesh = registry_.FindMesh(id.mesh);
  if (!mesh) return NoSuchTree();  // deleted meanwhile
  auto attributes = attribute_loader_.Load(id.mesh, mesh->bytes, kinds, cancel);
  if (!attributes.ok() && attributes.error().code == ErrorCode::kCorrupt) {
    (void)registry_.NoteMeshDamaged(id.mesh);
  }
  return attributes;
}

Result<std::vector<std::string>> TreeLibrary::GroupNames(const TreeId& id,
                                                         const CancelToken& cancel) {
  Result<std::vector<std::string>> stored = store_->ReadGroupNames(id.mesh);
  if (stored.ok()) return stored;
  const auto attributes = LoadAttributes(id, {}, cancel);
  if (!attributes.ok()) return attributes.error();
  const std::span<const std::string> names = (*attributes)->group_names();
  return std::vector<std::string>(names.begin(), names.end());
}

Result<std::vector<TreeInfo>> TreeLibrary::ListAll(const std::optional<Sha256Digest>& mesh,
                                                   const std::optional<Position>& after,
                                                   std::size_t limit) {
  if (shared_ != nullptr) return shared_->List(mesh, after, limit);
  return List(mesh, after, limit);
}

std::vector<TreeInfo> TreeLibrary::List(const std::optional<Sha256Digest>& mesh,
                                        const std::optional<Position>& after, std::size_t limit) {
  return registry_.List(mesh, after, limit);
}

Status TreeLibrary::Delete(const TreeId& id) {
  std::optional<bool> was_shared;
  if (shared_ != nullptr) {
    // First, so a failure changes nothing.
    const Result<bool> removed = shared_->Remove(id);
    if (!removed.ok()) return removed.error();
    was_shared = *removed;
  }
  const std::lock_guard files_lock(mesh_locks_.Of(id.mesh));
  if (registry_.ForgetFailure(id)) return {};
  Status removed = remover_.Remove(id, NoSuchTree());
  if (!was_shared) return removed;
  // What remains here because of the disk is removed when it is next asked for.
  return *was_shared ? Status() : Status(NoSuchTree());
}

// Before the mesh's file is read.
Status TreeLibrary::CheckMesh(const TreeId& id, const CancelToken& cancel) {
  if (Status status = Ensure(id, cancel); !status.ok()) return status;
  if (Status status = registry_.Check(id); !status.ok()) return status;
  return shared_ == nullptr ? Status() : shared_->BringMesh(id.mesh, cancel);
}

Result<std::unique_ptr<ReadableFile>> TreeLibrary::OpenMesh(const TreeId& id,
                                                            const CancelToken& cancel) {
  if (Status status = CheckMesh(id, cancel); !status.ok()) return std::move(status).error();
  Result<std::unique_ptr<ReadableFile>> file = store_->OpenMesh(id.mesh, cancel);
  if (!file.ok() && file.error().code == ErrorCode::kCorrupt &&
      !registry_.NoteMeshDamaged(id.mesh)) {
    return NoSuchTree();  // deleted meanwhile
  }
  return file;
}

Status TreeLibrary::Measure(const TreeId& id, TradeoffOptions options) {
  if (Status status = Ensure(id, CancelToken()); !status.ok()) return status;
  return measurer_.Measure(id, std::move(options));
}

Result<std::optional<Measurements::Info>> TreeLibrary::WaitForMeasured(
    const TreeId& id, SteadyClock::time_point until, const CancelToken& cancel) {
  if (Status status = Ensure(id, cancel); !status.ok()) return std::move(status).error();
  return measurer_.Wait(id, until, cancel);
}

Result<bool> TreeLibrary::ForgetMeasured(const TreeId& id) {
  if (Status status = Ensure(id, CancelToken()); !status.ok()) return std::move(status).error();
  return measurer_.Forget(id);
}

LibraryCounters TreeLibrary::counters() const {
  LibraryCounters counters;
  counters.parses = loader_.parses();
  counters.builds = loader_.builds();
  counters.loads = loader_.loads();
  counters.cache_hits = cache_hits_;
  counters.binary_rebuilds = binary_rebuilder_.rebuilds();
  counters.attribute_reads = attribute_loader_.reads();
  counters.damaged_files = store_->damaged_files();
  counters.evictions = cache_.evictions();
  counters.memory_bytes = budget_.used();
  counters.store_bytes = store_->bytes();
  counters.unrecorded_meshes = store_->unrecorded_meshes();
  const TreeRegistry::Counts counts = registry_.counts();
  counters.unreadable_meshes = counts.damaged_meshes;
  counters.rebuilds = counts.rebuilds;
  counters.trees = counts.trees;
  if (shared_ != nullptr) counters.shared = shared_->counts();
  return counters;
}

}  // namespace kdray::core
