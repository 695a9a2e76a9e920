// SPDX-License-Identifier: Apache-2.0
#include "core/proximity/closest_points.h"

#include <algorithm>
#include <atomic>
#include <cassert>
#include <vector>

#include "core/base/parallel.h"
#include "core/geometry/power_of_two.h"
#include "core/proximity/closest_kernel.h"
#include "core/proximity/point_batch.h"
#include "core/proximity/point_search.h"

namespace kdray::core {
namespace {

// Points that one thread takes at a time.
constexpr std::size_t kBlockPoints = 1024;
// A point on the surface is found within this distance, local units; double errs by less.
constexpr double kSurfaceDistance = 0x1p-40;

ClosestPoint NoPoint(const Vec3d& point) {
  ClosestPoint none;
  if (!IsValidPoint(point)) none.distance = std::numeric_limits<double>::quiet_NaN();
  return none;
}

/// The searches of one thread.
class Searcher {
 public:
  Searcher(const Scene& scene, const PointOptions& options, CancelPoll* poll)
      : mesh_(*scene.mesh),
        tree_(scene.tree->wide),
        local_bounds_{mesh_.frame().ToLocal(mesh_.bounds().min),
                      mesh_.frame().ToLocal(mesh_.bounds().max)},
        kernels_(
            FindPointKernels(options.simd.value_or(BestSimdLevel()), mesh_.has_double_vertices())),
        stack_(tree_.stack_size),
        poll_(poll),
        judge_(mesh_) {}

  SearchPoint Prepare(const Vec3d& world) const {
    return MakeSearchPoint(world, mesh_.frame(), local_bounds_);
  }

  /// In double; no point is beyond kKernelRange.
  void FindInDouble(std::span<const SearchPoint> points, std::span<PrimitiveId> closest) {
    kernels_.closest(Job(), points, closest);
  }
  ClosestPoint FinishInDouble(const SearchPoint& point, PrimitiveId id) const {
    const TriangleFoot foot = FootOnTriangle(point.at, mesh_.LocalCorner(id, 0),
                                             mesh_.LocalCorner(id, 1), mesh_.LocalCorner(id, 2));
    ClosestPoint answer;
    answer.distance = std::min(ScaleByPowerOfTwo(std::sqrt(foot.square), mesh_.frame().exponent),
                               std::numeric_limits<double>::max());
    answer.point = mesh_.frame().ToWorld(foot.point) + Vec3d{};  // -0 becomes 0
    answer.u = foot.u + 0.0;
    answer.v = foot.v + 0.0;
    answer.primitive_id = id;
    return answer;
  }

  ClosestPoint FindExactly(const SearchPoint& point, const Vec3d& world, PrimitiveId candidate) {
    judge_.Begin(point, world);
    if (candidate != kNoPrimitive) judge_.Offer(candidate, poll_);
    Walk(point);
    if (judge_.id() == kNoPrimitive || poll_->stopped()) return NoPoint(world);
    const ExactFoot foot = judge_.Finish();
    return {foot.distance, foot.point, foot.u, foot.v, judge_.id()};
  }

  bool IsOnSurface(const SearchPoint& point, const Vec3d& world) {
    judge_.Begin(point, world, kSurfaceDistance);
    Walk(point);
    return judge_.IsOnSurface();
  }

 private:
  PointJob Job() { return {&tree_, &mesh_, stack_, poll_}; }
  void Walk(const SearchPoint& point) {
    if (point.size <= kKernelRange) {
      kernels_.exact(Job(), point, &judge_);
    } else {
      SearchPlainly(tree_, point, &judge_, poll_);
    }
  }

  const TriangleMesh& mesh_;
  const WideTree& tree_;
  const Bounds3d local_bounds_;
  const PointKernels kernels_;
  std::vector<PointStackEntry> stack_;
  CancelPoll* poll_;
  ExactJudge judge_;
};

/// f(rows, searcher) for blocks of row numbers, in parallel; the rows of a block are near each
/// other.
template <class F>
Status ForEachBlock(const Scene& scene, std::span<const Vec3d> points, const PointOptions& options,
                    const F& f) {
  std::atomic<bool> stopped{false};
  ParallelFor(0, points.size(), kSortedPoints, [&](std::size_t first, std::size_t last) {
    if (stopped.load(std::memory_order_relaxed)) return;
    std::vector<std::uint32_t> rows(last - first);
    OrderPoints(points, scene.mesh->bounds(), first, rows);
    ParallelFor(0, rows.size(), kBlockPoints, [&](std::size_t begin, std::size_t end) {
      if (stopped.load(std::memory_order_relaxed)) return;
      CancelPoll poll(options.cancel);
      if (!poll.Spend(1)) {
        Searcher searcher(scene, options, &poll);
        f(std::span<const std::uint32_t>(rows).subspan(begin, end - begin), &searcher, &poll);
      }
      if (poll.stopped()) stopped.store(true, std::memory_order_relaxed);
    });
  });
  if (stopped) return options.cancel.ToError();
  return {};
}

void FindBlockInDouble(std::span<const Vec3d> points, std::span<const std::uint32_t> rows,
                       Searcher* searcher, CancelPoll* poll, std::span<ClosestPoint> answers) {
  std::vector<SearchPoint> near;
  std::vector<std::uint32_t> near_rows;
  near.reserve(rows.size());
  near_rows.reserve(rows.size());
  for (const std::uint32_t row : rows) {
    if (!IsValidPoint(points[row])) {
      answers[row] = NoPoint(points[row]);
      continue;
    }
    const SearchPoint point = searcher->Prepare(points[row]);
    if (point.size <= kKernelRange) {
      near.push_back(point);
      near_rows.push_back(row);
    } else {
      answers[row] = searcher->FindExactly(point, points[row], kNoPrimitive);
      if (poll->stopped()) return;
    }
  }
  std::vector<PrimitiveId> closest(near.size(), kNoPrimitive);
  searcher->FindInDouble(near, closest);
  if (poll->stopped()) return;
  for (std::size_t i = 0; i < near.size(); ++i) {
    answers[near_rows[i]] = closest[i] == kNoPrimitive
                                ? NoPoint(points[near_rows[i]])
                                : searcher->FinishInDouble(near[i], closest[i]);
  }
}

}  // namespace

Status FindClosestPoints(const Scene& scene, std::span<const Vec3d> points,
                         const PointOptions& options, std::span<ClosestPoint> answers) {
  assert(answers.size() == points.size());
  return ForEachBlock(
      scene, points, options,
      [&](std::span<const std::uint32_t> rows, Searcher* searcher, CancelPoll* poll) {
        if (options.precision == PointPrecision::kDouble) {
          FindBlockInDouble(points, rows, searcher, poll, answers);
          return;
        }
        PrimitiveId candidate = kNoPrimitive;
        for (const std::uint32_t row : rows) {
          if (poll->Spend(kPointWork)) return;
          answers[row] = NoPoint(points[row]);
          if (!IsValidPoint(points[row])) continue;
          answers[row] =
              searcher->FindExactly(searcher->Prepare(points[row]), points[row], candidate);
          candidate = answers[row].primitive_id;
        }
      });
}

Status FindOnSurface(const Scene& scene, std::span<const Vec3d> points, const PointOptions& options,
                     std::span<std::uint8_t> on_surface) {
  assert(on_surface.size() == points.size());
  return ForEachBlock(
      scene, points, options,
      [&](std::span<const std::uint32_t> rows, Searcher* searcher, CancelPoll* poll) {
        for (const std::uint32_t row : rows) {
          if (poll->Spend(kPointWork)) return;
          on_surface[row] = 0;
          if (!scene.mesh->bounds().Contains(points[row])) continue;
          on_surface[row] = searcher->IsOnSurface(searcher->Prepare(points[row]), points[row]);
        }
      });
}

}  // namespace kdray::core
