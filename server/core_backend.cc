// SPDX-License-Identifier: Apache-2.0
#include "server/core_backend.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include "core/library/tree_library.h"
#include "server/core_loaded_tree.h"
#include "server/mapping.h"

namespace kdray::server {
namespace {

using SteadyClock = std::chrono::steady_clock;

api::Problem StillBuilding(double progress) {
  return {.code = api::ErrorCode::kTreeBuilding,
          .detail = "the tree was not built in time, " +
                    std::to_string(static_cast<int>(progress * 100)) +
                    " percent of the work is done"};
}

api::Problem NotMeasured() {
  return {.code = api::ErrorCode::kNotMeasured,
          .detail = "nothing has been measured for this tree; POST starts a measurement"};
}

/// What the disk of `folder` has left for this process.
std::optional<std::uint64_t> FreeBytes(const std::filesystem::path& folder) {
  std::error_code error;
  const std::filesystem::space_info space = std::filesystem::space(folder, error);
  if (error) return std::nullopt;
  return space.available;
}

SharedStoreCounters SharedCounters(const core::SharedTrees::Counts& counts) {
  SharedStoreCounters shared;
  constexpr std::array<std::string_view, core::kStoreOperations> kNames = {"list", "head", "get",
                                                                           "put", "delete"};
  for (std::size_t i = 0; i < kNames.size(); ++i) {
    const core::StoreCounts::Requests& requests = counts.requests.requests[i];
    shared.requests.push_back({kNames[i], requests.answered, requests.failed});
  }
  std::uint64_t sum = 0;
  for (std::size_t i = 0; i < counts.requests.by_time.size(); ++i) {
    const auto& ends = core::StoreCounts::kMostSeconds;
    sum += counts.requests.by_time[i];
    shared.times.push_back(
        {i < ends.size() ? ends[i] : std::numeric_limits<double>::infinity(), sum});
  }
  shared.seconds = counts.requests.seconds;
  shared.retries = counts.retries.retries;
  shared.sent_bytes = counts.requests.sent_bytes;
  shared.received_bytes = counts.requests.received_bytes;
  shared.lookups = counts.lookups;
  shared.meshes = {counts.meshes.here, counts.meshes.fetched};
  shared.trees = {counts.trees.here, counts.trees.fetched};
  shared.is_away = counts.retries.is_away;
  return shared;
}

class CoreMeshBytes final : public MeshBytes {
 public:
  explicit CoreMeshBytes(std::unique_ptr<core::ReadableFile> file) : file_(std::move(file)) {}
  std::uint64_t size() const override { return file_->size(); }
  bool Read(std::uint64_t offset, std::span<std::byte> out) const override {
    return file_->ReadAt(offset, out).ok();
  }

 private:
  std::unique_ptr<core::ReadableFile> file_;
};

class CoreMeshUpload final : public MeshUpload {
 public:
  CoreMeshUpload(core::TreeLibrary* library, core::TreeLibrary::Upload upload)
      : library_(library), upload_(std::move(upload)) {}

  api::Check Append(std::span<const std::byte> bytes) override {
    return ToCheck(upload_.Append(bytes));
  }
  api::Outcome<Stored> Finish(api::Build build) override {
    const auto added = library_->Finish(std::move(upload_), ToCore(build));
    if (!added.ok()) return ToProblem(added.error());
    return Stored{added->id.ToString(), added->existed};
  }

 private:
  core::TreeLibrary* library_;
  core::TreeLibrary::Upload upload_;
};

class LibraryBackend final : public Backend {
 public:
  LibraryBackend(const CoreBackendOptions& options, std::unique_ptr<core::TreeLibrary> library)
      : data_dir_(options.data_dir),
        memory_limit_bytes_(options.memory_limit_bytes),
        store_limit_bytes_(options.store_limit_bytes),
        runner_{options.limits, QueryArenas(options.threads)},
        library_(std::move(library)) {}
  ~LibraryBackend() override { Shutdown(); }

  api::Outcome<std::unique_ptr<MeshUpload>> BeginUpload(std::uint64_t size) override {
    auto upload = library_->BeginUpload(size);
    if (!upload.ok()) return ToProblem(upload.error());
    return std::unique_ptr<MeshUpload>(
        std::make_unique<CoreMeshUpload>(library_.get(), *std::move(upload)));
  }

  api::Outcome<MeshUpload::Stored> BuildStored(std::string_view sha256, api::Build build) override {
    core::Sha256Digest mesh;
    if (!core::ParseSha256Hex(sha256, &mesh)) {
      return ToProblem({core::ErrorCode::kNotFound, "no mesh has this SHA-256"},
                       api::ErrorCode::kMeshNotFound);
    }
    const auto added = library_->AddBuild(mesh, ToCore(build));
    if (!added.ok()) return ToProblem(added.error(), api::ErrorCode::kMeshNotFound);
    return MeshUpload::Stored{added->id.ToString(), added->existed};
  }

  api::Check Find(std::string_view id) override {
    const api::Outcome<core::TreeId> tree_id = ToTreeId(id);
    if (!tree_id.ok()) return tree_id.problem();
    const core::Result<core::TreeInfo> info = library_->Find(*tree_id);
    if (info.ok()) return std::nullopt;
    return ToProblem(info.error());
  }

  api::Outcome<api::TreeDescription> Describe(std::string_view id, SteadyClock::time_point until,
                                              const CancelToken& cancel) override {
    const api::Outcome<core::TreeId> tree_id = ToTreeId(id);
    if (!tree_id.ok()) return tree_id.problem();
    const core::Result<core::TreeInfo> info = library_->Wait(*tree_id, until, cancel);
    if (!info.ok()) return ToProblem(info.error());
    api::TreeDescription description = ToApi(*info);
    if (info->record.mesh) AddGroups(*tree_id, *info->record.mesh, cancel, &description.mesh);
    return description;
  }

  api::Outcome<std::unique_ptr<const LoadedTree>> Acquire(std::string_view id, TreeUse use,
                                                          const CancelToken& cancel) override {
    const api::Outcome<core::TreeId> tree_id = ToTreeId(id);
    if (!tree_id.ok()) return tree_id.problem();
    core::Result<core::Scene> scene = use == TreeUse::kCells
                                          ? library_->LoadWithBinary(*tree_id, cancel)
                                          : library_->Load(*tree_id, cancel);
    if (scene.ok()) {
      return MakeCoreLoadedTree(&runner_, library_.get(), *tree_id, *std::move(scene));
    }
    if (scene.error().code == core::ErrorCode::kDeadlineExceeded) {
      const core::Result<core::TreeInfo> info = library_->Find(*tree_id);
      if (info.ok() && !info->ready()) return StillBuilding(info->progress);
    }
    return ToProblem(scene.error());
  }

  api::Outcome<api::TreePage> List(std::string_view mesh, std::size_t limit,
                                   std::string_view after) override {
    api::TreePage page;
    std::optional<core::Sha256Digest> digest;
    if (!mesh.empty() && !core::ParseSha256Hex(mesh, &digest.emplace())) return page;
    std::optional<core::TreeLibrary::Position> position;
    if (!after.empty()) {
      position = ParseCursor(after);
      if (!position) {
        return ToProblem({.code = core::ErrorCode::kInvalidArgument,
                          .message = "must be `next` of an earlier page, unchanged",
                          .field = "after"});
      }
    }
    // One more than requested shows whether there is a next page.
    const auto trees = library_->ListAll(digest, position, limit + 1);
    if (!trees.ok()) return ToProblem(trees.error());
    const std::size_t count = std::min(limit, trees->size());
    for (std::size_t i = 0; i < count; ++i) page.trees.push_back(ToApi((*trees)[i]));
    if (trees->size() > limit && limit > 0) page.next = FormatCursor((*trees)[limit - 1]);
    return page;
  }

  api::Check Delete(std::string_view id) override {
    const api::Outcome<core::TreeId> tree_id = ToTreeId(id);
    if (!tree_id.ok()) return tree_id.problem();
    return ToCheck(library_->Delete(*tree_id));
  }

  api::Outcome<std::unique_ptr<MeshBytes>> OpenMesh(std::string_view id,
                                                    const CancelToken& cancel) override {
    const api::Outcome<core::TreeId> tree_id = ToTreeId(id);
    if (!tree_id.ok()) return tree_id.problem();
    auto file = library_->OpenMesh(*tree_id, cancel);
    if (!file.ok()) return ToProblem(file.error());
    return std::unique_ptr<MeshBytes>(std::make_unique<CoreMeshBytes>(*std::move(file)));
  }

  api::Check Measure(std::string_view id) override {
    const api::Outcome<core::TreeId> tree_id = ToTreeId(id);
    if (!tree_id.ok()) return tree_id.problem();
    core::TradeoffOptions options;
    options.is_disturbed = [this] { return runner_.queries != 0; };
    if (getloadavg(&options.load_average, 1) != 1) options.load_average = 0;
    return ToCheck(library_->Measure(*tree_id, std::move(options)));
  }

  api::Outcome<api::Tradeoff> WaitForTradeoff(std::string_view id, SteadyClock::time_point until,
                                              const CancelToken& cancel) override {
    const api::Outcome<core::TreeId> tree_id = ToTreeId(id);
    if (!tree_id.ok()) return tree_id.problem();
    const auto info = library_->WaitForMeasured(*tree_id, until, cancel);
    if (!info.ok()) return ToProblem(info.error());
    if (!*info) return NotMeasured();
    if ((*info)->measured) return ToApi(*(*info)->measured);
    api::Tradeoff measuring;
    measuring.progress = (*info)->progress;
    return measuring;
  }

  api::Check ForgetTradeoff(std::string_view id) override {
    const api::Outcome<core::TreeId> tree_id = ToTreeId(id);
    if (!tree_id.ok()) return tree_id.problem();
    const core::Result<bool> forgotten = library_->ForgetMeasured(*tree_id);
    if (!forgotten.ok()) return ToProblem(forgotten.error());
    if (!*forgotten) return NotMeasured();
    return std::nullopt;
  }

  core::MemoryBudget* memory() override { return library_->memory(); }

  void Shutdown() override { library_->Shutdown(); }

  BackendCounters counters() const override {
    const core::LibraryCounters c = library_->counters();
    return {c.parses,
            c.builds,
            c.loads,
            c.cache_hits,
            c.rebuilds,
            c.damaged_files,
            c.evictions,
            c.memory_bytes,
            c.store_bytes,
            c.trees,
            c.unrecorded_meshes,
            c.unreadable_meshes,
            c.binary_rebuilds,
            c.attribute_reads,
            memory_limit_bytes_,
            store_limit_bytes_,
            FreeBytes(data_dir_),
            c.shared ? std::optional(SharedCounters(*c.shared)) : std::nullopt};
  }

 private:
  // A description without the names of groups is better than none.
  void AddGroups(const core::TreeId& id, const core::MeshFacts& facts, const CancelToken& cancel,
                 api::MeshDescription* mesh) {
    if (!facts.groups) return;
    core::Result<std::vector<std::string>> names = std::vector<std::string>();
    if (*facts.groups != 0) names = library_->GroupNames(id, cancel);
    if (names.ok()) mesh->groups = *std::move(names);
  }

  const std::filesystem::path data_dir_;
  const std::uint64_t memory_limit_bytes_;
  const std::optional<std::uint64_t> store_limit_bytes_;
  QueryRunner runner_;
  std::unique_ptr<core::TreeLibrary> library_;
};

}  // namespace

core::Result<std::unique_ptr<Backend>> MakeCoreBackend(CoreBackendOptions options) {
  if (options.threads < 1) {
    return core::Error{core::ErrorCode::kInvalidArgument, "threads must be at least 1"};
  }
  core::LibraryOptions library_options;
  library_options.data_dir = options.data_dir;
  library_options.file_system = options.file_system;
  library_options.build_threads = options.threads;
  library_options.memory_limit_bytes = options.memory_limit_bytes;
  library_options.store_limit_bytes = options.store_limit_bytes;
  library_options.shared = std::move(options.shared);
  auto library = core::TreeLibrary::Open(library_options);
  if (!library.ok()) return std::move(library).error();
  return std::unique_ptr<Backend>(std::make_unique<LibraryBackend>(options, *std::move(library)));
}

}  // namespace kdray::server
