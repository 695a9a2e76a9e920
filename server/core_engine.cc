#include "server/core_engine.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <new>
#include <string>
#include <utility>
#include <vector>

#include "core/base/parallel.h"
#include "core/io/png_writer.h"
#include "core/library/tree_library.h"
#include "core/render/picture.h"
#include "core/render/renderer.h"
#include "core/trace/trace.h"
#include "server/mapping.h"
#include "server/ray_queries.h"

namespace kdray::server {
namespace {

using SteadyClock = std::chrono::steady_clock;

double MillisecondsSince(SteadyClock::time_point start) {
  return std::chrono::duration<double, std::milli>(SteadyClock::now() - start).count();
}

api::Problem OutOfMemory() {
  return ToProblem({core::ErrorCode::kMemoryFull, "the system has no memory for this answer now"});
}

/// For a picture that is to be ready by the deadline: a fifth of what is left is for the rest.
std::chrono::milliseconds TimeToTrace(const CancelToken& cancel) {
  if (cancel.deadline() == SteadyClock::time_point::max()) return std::chrono::milliseconds::max();
  const auto left =
      std::chrono::duration_cast<std::chrono::milliseconds>(cancel.deadline() - SteadyClock::now());
  return std::max(left * 4 / 5, std::chrono::milliseconds(1));
}

api::Problem TooManyCells(std::string_view parameter, std::int64_t depth, std::uint64_t limit) {
  return {.code = api::ErrorCode::kTooManyCells,
          .detail = "at depth " + std::to_string(depth) + " there are more than " +
                    std::to_string(limit) + " cells",
          .parameter = std::string(parameter),
          .limit = static_cast<double>(limit)};
}

api::Problem NotMeasured() {
  return {.code = api::ErrorCode::kNotMeasured,
          .detail = "nothing has been measured for this tree; POST begins it"};
}

/// One more in a count for as long as it lives.
class Counted {
 public:
  explicit Counted(std::atomic<int>* count) : count_(count) { ++*count_; }
  ~Counted() { --*count_; }
  Counted(const Counted&) = delete;
  Counted& operator=(const Counted&) = delete;

 private:
  std::atomic<int>* count_;
};

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
    const core::Status status = upload_.Append(bytes);
    if (status.ok()) return std::nullopt;
    return ToProblem(status.error());
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

class RealEngine final : public CoreEngine {
 public:
  RealEngine(const CoreEngineOptions& options, std::unique_ptr<core::TreeLibrary> library)
      : limits_(options.limits), arena_(options.threads), library_(std::move(library)) {}
  ~RealEngine() override { Shutdown(); }

  api::Outcome<std::unique_ptr<MeshUpload>> BeginUpload(std::uint64_t size) override {
    if (size > limits_.max_upload_bytes) {
      api::Problem problem;
      problem.code = api::ErrorCode::kMeshTooLarge;
      problem.detail = "the mesh has " + std::to_string(size) + " bytes; at most " +
                       std::to_string(limits_.max_upload_bytes) + " are taken";
      problem.limit = static_cast<double>(limits_.max_upload_bytes);
      problem.actual = static_cast<double>(size);
      return problem;
    }
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

  api::Outcome<api::TreeDescription> Describe(std::string_view id) override {
    return WaitUntilBuilt(id, SteadyClock::now(), CancelToken());
  }

  api::Outcome<api::TreeDescription> WaitUntilBuilt(std::string_view id,
                                                    SteadyClock::time_point until,
                                                    const CancelToken& cancel) override {
    const api::Outcome<core::TreeId> tree_id = ToTreeId(id);
    if (!tree_id.ok()) return tree_id.problem();
    const core::Result<core::TreeInfo> info = library_->Wait(*tree_id, until, cancel);
    if (!info.ok()) return ToProblem(info.error());
    return ToApi(*info);
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
                          .message = "must be `next` of an earlier page, as it came",
                          .field = "after"});
      }
    }
    // One more than asked for tells whether there is a next page.
    const std::vector<core::TreeInfo> trees = library_->List(digest, position, limit + 1);
    const std::size_t count = std::min(limit, trees.size());
    for (std::size_t i = 0; i < count; ++i) page.trees.push_back(ToApi(trees[i]));
    if (trees.size() > limit && limit > 0) page.next = FormatCursor(trees[limit - 1]);
    return page;
  }

  api::Check Delete(std::string_view id) override {
    const api::Outcome<core::TreeId> tree_id = ToTreeId(id);
    if (!tree_id.ok()) return tree_id.problem();
    const core::Status status = library_->Delete(*tree_id);
    if (status.ok()) return std::nullopt;
    return ToProblem(status.error());
  }

  api::Outcome<std::unique_ptr<MeshBytes>> OpenMesh(std::string_view id,
                                                    const CancelToken& cancel) override {
    const api::Outcome<core::TreeId> tree_id = ToTreeId(id);
    if (!tree_id.ok()) return tree_id.problem();
    auto file = library_->OpenMesh(*tree_id, cancel);
    if (!file.ok()) return ToProblem(file.error());
    return std::unique_ptr<MeshBytes>(std::make_unique<CoreMeshBytes>(*std::move(file)));
  }

  api::Outcome<api::ClosestAnswer> Closest(std::string_view id, const api::RayTable& rays,
                                           const api::RayOptions& options,
                                           const CancelToken& cancel) override {
    return Query<api::ClosestAnswer>(
        id, options.precision, cancel,
        [&](const core::Scene& scene, const core::TraceOptions& trace, api::ClosestAnswer* answer) {
          return AnswerClosest(scene, rays, options, trace, answer);
        });
  }

  api::Outcome<api::AnyAnswer> Any(std::string_view id, const api::RayTable& rays,
                                   const api::RayOptions& options,
                                   const CancelToken& cancel) override {
    return Query<api::AnyAnswer>(
        id, options.precision, cancel,
        [&](const core::Scene& scene, const core::TraceOptions& trace, api::AnyAnswer* answer) {
          return AnswerAny(scene, rays, trace, answer);
        });
  }

  api::Outcome<api::RenderAnswer> Render(std::string_view id, const api::RenderRequest& request,
                                         bool png, const CancelToken& cancel) override {
    auto rendered = Query<api::RenderAnswer>(
        id, request.precision, cancel,
        [&](const core::Scene& scene, const core::TraceOptions& trace,
            api::RenderAnswer* answer) -> core::Status {
          const auto start = SteadyClock::now();
          core::RenderSpec spec = ToCore(request, trace.precision);
          spec.max_cells = static_cast<std::size_t>(limits_.max_picture_cells);
          if (spec.budget) spec.budget = std::min(*spec.budget, TimeToTrace(cancel));
          core::Result<core::RenderedImage> image = core::Render(scene, spec, cancel);
          if (!image.ok()) return std::move(image).error();
          answer->samples = image->samples;
          answer->noise = image->noise;
          answer->stopped = ToApi(image->stopped);
          answer->trace_ms = MillisecondsSince(start);
          if (!png) {
            answer->image = ToApi(*std::move(image));
            return {};
          }
          const auto encode_start = SteadyClock::now();
          const core::Result<core::Picture> picture = core::MakePicture(*image, cancel);
          if (!picture.ok()) return picture.error();
          core::Result<std::vector<std::byte>> bytes = core::EncodePng(
              picture->pixels, picture->width, picture->height, picture->channels, cancel);
          if (!bytes.ok()) return std::move(bytes).error();
          answer->image = *std::move(bytes);
          answer->encode_ms = MillisecondsSince(encode_start);
          return {};
        },
        request.cells_depth ? Form::kWithBinary : Form::kWide);
    // Depths are checked before: only their number of cells can be wrong.
    if (!rendered && rendered.problem().parameter == "cells_depth") {
      return TooManyCells("cells_depth", *request.cells_depth, limits_.max_picture_cells);
    }
    return rendered;
  }

  api::Outcome<std::vector<api::Cell>> Cells(std::string_view id, std::uint32_t depth,
                                             const CancelToken& cancel) override {
    const auto scene = Load(id, Form::kWithBinary, cancel);
    if (!scene.ok()) return scene.problem();
    const auto cells = scene->Cells(depth, static_cast<std::size_t>(limits_.max_cells), cancel);
    if (!cells.ok() && cells.error().code == core::ErrorCode::kInvalidArgument) {
      return TooManyCells("depth", depth, limits_.max_cells);
    }
    if (!cells.ok()) return ToProblem(cells.error());
    std::vector<api::Cell> answer;
    answer.reserve(cells->size());
    for (const core::TreeCell& cell : *cells) answer.push_back(ToApi(cell));
    return answer;
  }

  api::Check Measure(std::string_view id) override {
    const api::Outcome<core::TreeId> tree_id = ToTreeId(id);
    if (!tree_id.ok()) return tree_id.problem();
    core::TradeoffOptions options;
    options.is_disturbed = [this] { return queries_ != 0; };
    if (getloadavg(&options.load_average, 1) != 1) options.load_average = 0;
    const core::Status status = library_->Measure(*tree_id, std::move(options));
    if (!status.ok()) return ToProblem(status.error());
    return std::nullopt;
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

  bool IsReady() const override { return !shut_down_; }
  void Shutdown() override {
    shut_down_ = true;
    library_->Shutdown();
  }

  EngineCounters counters() const override {
    const core::LibraryCounters c = library_->counters();
    return {c.parses,
            c.builds,
            c.loads,
            c.rebuilds,
            c.damaged_files,
            c.evictions,
            c.memory_bytes,
            c.store_bytes,
            c.trees,
            c.unrecorded_meshes,
            c.unreadable_meshes,
            c.binary_rebuilds};
  }

 private:
  /// What a request needs of a tree.
  enum class Form : std::uint8_t { kWide, kWithBinary };

  api::Outcome<core::Scene> Load(std::string_view id, Form form, const CancelToken& cancel) {
    const api::Outcome<core::TreeId> tree_id = ToTreeId(id);
    if (!tree_id.ok()) return tree_id.problem();
    auto scene = form == Form::kWide ? library_->Load(*tree_id, cancel)
                                     : library_->LoadWithBinary(*tree_id, cancel);
    if (scene.ok()) return *std::move(scene);
    api::Problem problem = ToProblem(scene.error());
    if (scene.error().code == core::ErrorCode::kDeadlineExceeded) {
      // A tree that was never built needs patience; one that is only read in again was slow.
      const core::Result<core::TreeInfo> info = library_->Find(*tree_id);
      if (info.ok() && !info->ready()) {
        problem.code = api::ErrorCode::kTreeBuilding;
        problem.detail = "the tree was not built in time";
      }
    }
    return problem;
  }

  // Loads the tree, settles the precision, and runs `work` in the query arena.
  template <class Answer, class Work>
  api::Outcome<Answer> Query(std::string_view id, api::Precision asked, const CancelToken& cancel,
                             const Work& work, Form form = Form::kWide) {
    const auto scene = Load(id, form, cancel);
    if (!scene.ok()) return scene.problem();
    const core::Precision precision = ToCore(asked, core::AutoPrecision(*scene->mesh));
    Answer answer;
    answer.precision = ToApi(precision);
    try {
      core::Status status;
      const auto start = SteadyClock::now();
      const Counted counted(&queries_);
      arena_.Run([&] { status = work(*scene, {precision, cancel}, &answer); });
      if (!status.ok()) return ToProblem(status.error());
      if (answer.trace_ms == 0) answer.trace_ms = MillisecondsSince(start);
    } catch (const std::bad_alloc&) {
      return OutOfMemory();
    }
    return answer;
  }

  const api::Limits limits_;
  core::Arena arena_;
  std::atomic<bool> shut_down_{false};
  std::atomic<int> queries_{0};  // at work now; the library's measurings look at it
  std::unique_ptr<core::TreeLibrary> library_;
};

}  // namespace

core::Result<std::unique_ptr<CoreEngine>> MakeCoreEngine(CoreEngineOptions options) {
  if (options.threads < 1) {
    return core::Error{core::ErrorCode::kInvalidArgument, "threads must be at least 1"};
  }
  core::LibraryOptions library_options;
  library_options.data_dir = options.data_dir;
  library_options.file_system = options.file_system;
  library_options.build_threads = options.threads;
  library_options.memory_limit_bytes = options.memory_limit_bytes;
  library_options.store_limit_bytes = options.store_limit_bytes;
  auto library = core::TreeLibrary::Open(library_options);
  if (!library.ok()) return std::move(library).error();
  return std::unique_ptr<CoreEngine>(std::make_unique<RealEngine>(options, *std::move(library)));
}

}  // namespace kdray::server
