#include "server/core_backend.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <functional>
#include <new>
#include <string>
#include <utility>
#include <vector>

#include "core/base/parallel.h"
#include "core/intersect/hit_filter.h"
#include "core/io/mesh_attributes.h"
#include "core/io/png_writer.h"
#include "core/library/tree_library.h"
#include "core/render/depth_range.h"
#include "core/render/picture.h"
#include "core/render/renderer.h"
#include "core/trace/trace.h"
#include "server/mapping.h"
#include "server/point_queries.h"
#include "server/ray_queries.h"
#include "server/visibility_queries.h"

namespace kdray::server {
namespace {

using SteadyClock = std::chrono::steady_clock;

double MillisecondsSince(SteadyClock::time_point start) {
  return std::chrono::duration<double, std::milli>(SteadyClock::now() - start).count();
}

api::Problem OutOfMemory() {
  return ToProblem({core::ErrorCode::kMemoryFull, "the system has no memory for this answer now"});
}

/// For a picture that must be ready by the deadline: a fifth of the remaining time is for encoding.
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

api::Problem StillBuilding(double progress) {
  return {.code = api::ErrorCode::kTreeBuilding,
          .detail = "the tree was not built in time, " +
                    std::to_string(static_cast<int>(progress * 100)) +
                    " percent of the work is done"};
}

api::Check ToCheck(const core::Status& status) {
  if (status.ok()) return std::nullopt;
  return ToProblem(status.error());
}

api::Problem NotMeasured() {
  return {.code = api::ErrorCode::kNotMeasured,
          .detail = "nothing has been measured for this tree; POST starts a measurement"};
}

/// Increments a count during its lifetime.
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

/// Runs queries; shared by a backend and its handles.
struct QueryRunner {
  const api::Limits limits;
  core::Arena arena;
  std::atomic<int> queries{0};  ///< running now; the library's measurements read it
};

class CoreLoadedTree final : public LoadedTree {
 public:
  CoreLoadedTree(QueryRunner* runner, core::TreeLibrary* library, const core::TreeId& id,
                 core::Scene scene)
      : runner_(*runner), library_(*library), id_(id), scene_(std::move(scene)) {}

  api::Outcome<api::BatchReport> Closest(const api::RayTable& rays, const api::RayOptions& options,
                                         const CancelToken& cancel,
                                         api::RowSink<api::ClosestRows>* sink) const override {
    return Rays(rays, options, core::AutoPrecision(*scene_.mesh), cancel,
                [sink](const RayQuery& query, api::BatchReport* report) {
                  return AnswerClosest(query, sink, report);
                });
  }
  api::Outcome<api::BatchReport> Any(const api::RayTable& rays, const api::RayOptions& options,
                                     const CancelToken& cancel,
                                     api::RowSink<api::AnyRows>* sink) const override {
    return Rays(rays, options, core::AutoPrecision(*scene_.mesh), cancel,
                [sink](const RayQuery& query, api::BatchReport* report) {
                  return AnswerAny(query, sink, report);
                });
  }
  api::Outcome<api::BatchReport> Count(const api::RayTable& rays, const api::RayOptions& options,
                                       const CancelToken& cancel,
                                       api::RowSink<api::CountRows>* sink) const override {
    return Rays(rays, options, core::Precision::kExact, cancel,
                [sink](const RayQuery& query, api::BatchReport* report) {
                  return AnswerCount(query, sink, report);
                });
  }
  api::Outcome<api::BatchReport> All(const api::RayTable& rays, const api::RayOptions& options,
                                     const CancelToken& cancel,
                                     api::RowSink<api::AllRows>* sink) const override {
    return Rays(rays, options, core::Precision::kExact, cancel,
                [this, sink](const RayQuery& query, api::BatchReport* report) {
                  return AnswerAll(query, runner_.limits.MaxAnswerHits(), sink, report);
                });
  }

  void RunPieces(std::size_t count, const std::function<void(std::size_t)>& piece) const override {
    runner_.arena.Run([&] {
      core::ParallelFor(0, count, 1, [&](std::size_t first, std::size_t) { piece(first); });
    });
  }

  api::Outcome<api::PointReport> ClosestPoints(
      const api::PointTable& points, const api::PointOptions& options, const CancelToken& cancel,
      const PutRows<api::NearestPoint>& put) const override {
    return QueryPoints(options.precision, core::PointPrecision::kDouble, cancel,
                       [&](const core::PointOptions& query, api::PointReport* report) {
                         return AnswerClosestPoints(scene_, points, options, query, put, report);
                       });
  }

  api::Outcome<api::PointReport> SignedDistances(const api::PointTable& points,
                                                 const api::PointOptions& options,
                                                 const CancelToken& cancel,
                                                 const PutRows<double>& put) const override {
    return QueryPoints(options.precision, core::PointPrecision::kDouble, cancel,
                       [&](const core::PointOptions& query, api::PointReport* report) {
                         return AnswerSignedDistances(scene_, points, query, put, report);
                       });
  }

  api::Outcome<api::PointReport> Inside(const api::PointTable& points,
                                        const api::PointOptions& options, const CancelToken& cancel,
                                        const PutRows<std::int8_t>& put) const override {
    return QueryPoints(options.precision, core::PointPrecision::kExact, cancel,
                       [&](const core::PointOptions& query, api::PointReport* report) {
                         return AnswerInside(scene_, points, query, put, report);
                       });
  }

  api::Outcome<api::VisibilityAnswer> Visibility(const api::PointSets& sets,
                                                 const api::VisibilityOptions& options,
                                                 const CancelToken& cancel) const override {
    return Query<api::VisibilityAnswer>(
        options.precision, core::AutoPrecision(*scene_.mesh), cancel,
        [&](const core::TraceOptions& trace, api::VisibilityAnswer* answer) {
          return ToCheck(AnswerVisibility(scene_, sets, options, trace, answer));
        });
  }

  api::Outcome<api::RenderAnswer> Render(const api::RenderRequest& request, bool png,
                                         const CancelToken& cancel) const override {
    core::AttributeKinds kinds;
    if (request.smooth) kinds.Add(core::AttributeKind::kShadingNormal);
    if (request.file_color) kinds.Add(core::AttributeKind::kColor);
    if (request.edges) kinds.Add(core::AttributeKind::kEdges);
    std::shared_ptr<const core::MeshAttributes> attributes;
    if (!kinds.empty()) {
      auto loaded = Attributes(kinds, cancel);
      if (!loaded.ok()) return ToProblem(loaded.error());
      attributes = *std::move(loaded);
    }
    return Query<api::RenderAnswer>(
        request.precision, core::AutoPrecision(*scene_.mesh), cancel,
        [&](const core::TraceOptions&, api::RenderAnswer* answer) -> api::Check {
          const auto start = SteadyClock::now();
          core::RenderSpec spec = ToCore(request);
          if (!request.samples && !png) {
            const auto samples = api::DefaultSamples(request.mode, api::ImageForm::kNpy);
            if (samples) spec.samples = static_cast<int>(*samples);
          }
          AddSurface(request, attributes.get(), &spec);
          spec.max_cells = static_cast<std::size_t>(runner_.limits.max_picture_cells);
          if (spec.budget) spec.budget = std::min(*spec.budget, TimeToTrace(cancel));
          core::Result<core::RenderedImage> image = core::Render(scene_, spec, cancel);
          if (!image.ok()) {
            // Depths were checked before, so only the number of cells can be the cause.
            if (image.error().field == "cells_depth") {
              return TooManyCells("cells_depth", *request.cells_depth,
                                  runner_.limits.max_picture_cells);
            }
            return ToProblem(image.error());
          }
          if (png && request.mode == api::RenderMode::kDepth) {
            if (auto problem = SetDepthRange(request, cancel, &*image)) return problem;
            if (const auto& range = image->depth_range) {
              answer->depth_range = {range->near, range->far};
            }
          }
          answer->precision = ToApi(image->precision);
          answer->samples = image->samples;
          answer->noise = image->noise;
          answer->stopped = ToApi(image->stopped);
          answer->counts = ToApi(image->counts);
          answer->trace_ms = MillisecondsSince(start);
          if (png) return Encode(*image, cancel, answer);
          answer->image = ToApi(*std::move(image));
          return std::nullopt;
        });
  }

  api::Outcome<std::vector<api::Cell>> Cells(std::uint32_t depth,
                                             const CancelToken& cancel) const override {
    const std::uint64_t limit = runner_.limits.max_cells;
    const auto cells = scene_.Cells(depth, static_cast<std::size_t>(limit), cancel);
    if (!cells.ok() && cells.error().code == core::ErrorCode::kInvalidArgument) {
      return TooManyCells("depth", depth, limit);
    }
    if (!cells.ok()) return ToProblem(cells.error());
    std::vector<api::Cell> answer;
    answer.reserve(cells->size());
    for (const core::TreeCell& cell : *cells) answer.push_back(ToApi(cell));
    return answer;
  }

 private:
  api::Check SetDepthRange(const api::RenderRequest& request, const CancelToken& cancel,
                           core::RenderedImage* image) const {
    if (const auto& range = request.depth_range) {
      image->depth_range = {(*range)[0], (*range)[1]};
      return std::nullopt;
    }
    const auto range = core::RangeOfWholeImage(scene_, *image, cancel);
    if (!range.ok()) return ToProblem(range.error());
    image->depth_range = *range;
    return std::nullopt;
  }

  // Sets what the request takes from the mesh's file; `attributes` must outlive the spec.
  static void AddSurface(const api::RenderRequest& request, const core::MeshAttributes* attributes,
                         core::RenderSpec* spec) {
    if (request.edges) {
      spec->edges = [attributes](core::PrimitiveId id) { return attributes->Edges(id); };
    }
    if (request.smooth && attributes->has(core::AttributeKind::kShadingNormal)) {
      spec->smooth_normals = [attributes](core::PrimitiveId id, double u, double v) {
        return attributes->ShadingNormal(id, u, v);
      };
    }
    if (request.file_color && attributes->has(core::AttributeKind::kColor)) {
      spec->file_colors = [attributes](core::PrimitiveId id, double u, double v) {
        return attributes->Color(id, u, v);
      };
    }
  }

  static api::Check Encode(const core::RenderedImage& image, const CancelToken& cancel,
                           api::RenderAnswer* answer) {
    const auto start = SteadyClock::now();
    const core::Result<core::Picture> picture = core::MakePicture(image, cancel);
    if (!picture.ok()) return ToProblem(picture.error());
    core::Result<std::vector<std::byte>> bytes = core::EncodePng(
        picture->pixels, picture->width, picture->height, picture->channels, cancel);
    if (!bytes.ok()) return ToProblem(bytes.error());
    answer->image = *std::move(bytes);
    answer->encode_ms = MillisecondsSince(start);
    return std::nullopt;
  }

  // What the mesh's file says besides triangles, of the kinds that a request names. Read from the
  // file at the first such request, so call it only with kinds that are needed, and not in the
  // arena.
  core::Result<std::shared_ptr<const core::MeshAttributes>> Attributes(
      core::AttributeKinds kinds, const CancelToken& cancel) const {
    return library_.LoadAttributes(id_, kinds, cancel);
  }

  // The common part of ray queries. `automatic` is the precision of `auto`.
  template <class Work>
  api::Outcome<api::BatchReport> Rays(const api::RayTable& rays, const api::RayOptions& options,
                                      core::Precision automatic, const CancelToken& cancel,
                                      const Work& work) const {
    return Query<api::BatchReport>(
        options.precision, automatic, cancel,
        [&](core::TraceOptions trace, api::BatchReport* report) {
          trace.cull = ToCore(options.cull);
          trace.starts_on_surface = options.auto_t_min;
          trace.ends_on_surface = options.auto_t_max;
          if (options.auto_t_min || options.auto_t_max) {
            const bool in_float = rays.number_type() == api::NumberType::kF4;
            trace.surface_offset = core::SurfaceOffset(*scene_.mesh, trace.precision, in_float);
            report->offset = trace.surface_offset;
          }
          return work(RayQuery{scene_, rays, options, trace}, report);
        });
  }

  // Determines the precision, and runs `work` in the query arena. `automatic` is the precision of
  // `auto`.
  template <class Answer, class Work>
  api::Outcome<Answer> Query(api::Precision asked, core::Precision automatic,
                             const CancelToken& cancel, const Work& work) const {
    const core::Precision precision = ToCore(asked, automatic);
    Answer answer;
    answer.precision = ToApi(precision);
    try {
      api::Check problem;
      const auto start = SteadyClock::now();
      const Counted counted(&runner_.queries);
      runner_.arena.Run([&] { problem = work({precision, cancel}, &answer); });
      if (problem) return *std::move(problem);
      if (answer.trace_ms == 0) answer.trace_ms = MillisecondsSince(start);
    } catch (const std::bad_alloc&) {
      return OutOfMemory();
    }
    return answer;
  }

  // As Query, for points; `automatic` is the precision of `auto`.
  template <class Work>
  api::Outcome<api::PointReport> QueryPoints(api::PointPrecision asked,
                                             core::PointPrecision automatic,
                                             const CancelToken& cancel, const Work& work) const {
    const core::PointPrecision precision = ToCore(asked, automatic);
    api::PointReport report;
    report.precision = ToApi(precision);
    try {
      core::Status status;
      const Counted counted(&runner_.queries);
      runner_.arena.Run([&] {
        status = work(core::PointOptions{.precision = precision, .cancel = cancel}, &report);
      });
      if (!status.ok()) return ToProblem(status.error());
    } catch (const std::bad_alloc&) {
      return OutOfMemory();
    }
    return report;
  }

  QueryRunner& runner_;
  core::TreeLibrary& library_;
  const core::TreeId id_;
  const core::Scene scene_;
};

class LibraryBackend final : public Backend {
 public:
  LibraryBackend(const CoreBackendOptions& options, std::unique_ptr<core::TreeLibrary> library)
      : runner_{options.limits, core::Arena(options.threads)}, library_(std::move(library)) {}
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
      return std::unique_ptr<const LoadedTree>(
          std::make_unique<CoreLoadedTree>(&runner_, library_.get(), *tree_id, *std::move(scene)));
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
    const std::vector<core::TreeInfo> trees = library_->List(digest, position, limit + 1);
    const std::size_t count = std::min(limit, trees.size());
    for (std::size_t i = 0; i < count; ++i) page.trees.push_back(ToApi(trees[i]));
    if (trees.size() > limit && limit > 0) page.next = FormatCursor(trees[limit - 1]);
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
            c.attribute_reads};
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
  auto library = core::TreeLibrary::Open(library_options);
  if (!library.ok()) return std::move(library).error();
  return std::unique_ptr<Backend>(std::make_unique<LibraryBackend>(options, *std::move(library)));
}

}  // namespace kdray::server
