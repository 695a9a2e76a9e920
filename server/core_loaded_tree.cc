// SPDX-License-Identifier: Apache-2.0
#include "server/core_loaded_tree.h"

#include <chrono>
#include <functional>
#include <new>
#include <utility>
#include <vector>

#include "core/base/elapsed.h"
#include "core/base/parallel.h"
#include "core/intersect/hit_filter.h"
#include "core/io/mesh_attributes.h"
#include "core/trace/trace.h"
#include "server/hit_details.h"
#include "server/mapping.h"
#include "server/point_queries.h"
#include "server/ray_queries.h"
#include "server/render_queries.h"
#include "server/visibility_queries.h"

namespace kdray::server {
namespace {

using SteadyClock = std::chrono::steady_clock;

api::Problem OutOfMemory() {
  return ToProblem({core::ErrorCode::kMemoryFull, "the system has no memory for this answer now"});
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

class CoreLoadedTree final : public LoadedTree {
 public:
  CoreLoadedTree(QueryRunner* runner, core::TreeLibrary* library, const core::TreeId& id,
                 core::Scene scene)
      : runner_(*runner), library_(*library), id_(id), scene_(std::move(scene)) {}

  std::uint64_t bytes() const override { return scene_.mesh->bytes() + scene_.tree->most_bytes(); }

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
    runner_.arenas.Run([&] {
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
    auto attributes = Attributes(AttributesFor(request), cancel);
    if (!attributes.ok()) return ToProblem(attributes.error());
    return Query<api::RenderAnswer>(
        request.precision, core::AutoPrecision(*scene_.mesh), cancel,
        [&](const core::TraceOptions&, api::RenderAnswer* answer) {
          return AnswerRender({scene_, attributes->get(), runner_.limits, request, png, cancel},
                              answer);
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
  // What the mesh's file says besides triangles, of the kinds that a request names. Read from the
  // file at the first such request; null without kinds. Not to be called in the arena.
  core::Result<std::shared_ptr<const core::MeshAttributes>> Attributes(
      core::AttributeKinds kinds, const CancelToken& cancel) const {
    if (kinds.empty()) return std::shared_ptr<const core::MeshAttributes>();
    return library_.LoadAttributes(id_, kinds, cancel);
  }

  // The common part of ray queries. `automatic` is the precision of `auto`.
  template <class Work>
  api::Outcome<api::BatchReport> Rays(const api::RayTable& rays, const api::RayOptions& options,
                                      core::Precision automatic, const CancelToken& cancel,
                                      const Work& work) const {
    const auto attributes = Attributes(AttributesFor(options), cancel);
    if (!attributes.ok()) return ToProblem(attributes.error());
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
          return work(
              RayQuery{scene_, rays, options, trace,
                       static_cast<std::size_t>(runner_.arenas.threads()), attributes->get()},
              report);
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
      runner_.arenas.Run([&] { problem = work({precision, cancel}, &answer); });
      if (problem) return *std::move(problem);
      if (answer.trace_ms == 0) answer.trace_ms = core::MillisecondsSince(start);
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
      runner_.arenas.Run([&] {
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

}  // namespace

std::unique_ptr<const LoadedTree> MakeCoreLoadedTree(QueryRunner* runner,
                                                     core::TreeLibrary* library,
                                                     const core::TreeId& id, core::Scene scene) {
  return std::make_unique<CoreLoadedTree>(runner, library, id, std::move(scene));
}

}  // namespace kdray::server
