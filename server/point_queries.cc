// SPDX-License-Identifier: Apache-2.0
#include "server/point_queries.h"

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <limits>
#include <span>
#include <vector>

#include "core/base/parallel.h"
#include "core/proximity/point_batch.h"
#include "core/proximity/sides.h"
#include "core/render/shading.h"

namespace kdray::server {
namespace {

using SteadyClock = std::chrono::steady_clock;

// Points of a block: large enough to sort and share out, small enough that its answers take little
// memory.
constexpr std::size_t kBlockPoints = 65'536;
// Rows that one thread converts at a time.
constexpr std::size_t kGrainRows = 4096;

/// answer(points, first_row) for every block, with its time; `report` lists invalid rows.
template <class Answer, class Put>
core::Status ForEachBlock(const api::PointTable& table, api::PointReport* report,
                          const Answer& answer, const Put& put) {
  std::vector<core::Vec3d> points;
  std::size_t first = 0;
  do {
    const std::size_t count = std::min(kBlockPoints, table.size() - first);
    points.clear();
    for (std::size_t i = first; i < first + count; ++i) {
      const api::Vec3& row = table.rows[i];
      points.push_back({row[0], row[1], row[2]});
      if (!core::IsValidPoint(points.back())) report->invalid.push_back(i);
    }
    const auto start = SteadyClock::now();
    if (core::Status status = answer(std::span<const core::Vec3d>(points)); !status.ok()) {
      return status;
    }
    report->trace_ms +=
        std::chrono::duration<double, std::milli>(SteadyClock::now() - start).count();
    put(count);
    first += count;
  } while (first < table.size());
  return {};
}

api::Vec3 ToApi(const core::Vec3d& v) { return {v.x, v.y, v.z}; }

api::NearestPoint ToApi(const core::TriangleMesh& mesh, const core::ClosestPoint& found,
                        bool with_normal) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  constexpr api::Vec3 kNone = {kNan, kNan, kNan};
  if (!found.IsFound()) return {found.distance, kNone, kNone, 0, 0, -1};
  return {found.distance,
          ToApi(found.point),
          with_normal ? ToApi(core::UnitNormal(mesh, found.primitive_id)) : kNone,
          found.u,
          found.v,
          std::int64_t{found.primitive_id}};
}

}  // namespace

core::Status AnswerClosestPoints(const core::Scene& scene, const api::PointTable& points,
                                 const api::PointOptions& options, const core::PointOptions& query,
                                 const LoadedTree::PutRows<api::NearestPoint>& put,
                                 api::PointReport* report) {
  const bool with_normal = std::find(options.fields.begin(), options.fields.end(),
                                     api::PointField::kNormal) != options.fields.end();
  std::vector<core::ClosestPoint> found(std::min(points.size(), kBlockPoints));
  std::vector<api::NearestPoint> rows(found.size());
  return ForEachBlock(
      points, report,
      [&](std::span<const core::Vec3d> block) {
        return core::FindClosestPoints(scene, block, query, std::span(found).first(block.size()));
      },
      [&](std::size_t count) {
        core::ParallelFor(0, count, kGrainRows, [&](std::size_t i, std::size_t last) {
          for (; i < last; ++i) rows[i] = ToApi(*scene.mesh, found[i], with_normal);
        });
        put(std::span<const api::NearestPoint>(rows).first(count));
      });
}

core::Status AnswerSignedDistances(const core::Scene& scene, const api::PointTable& points,
                                   const core::PointOptions& query,
                                   const LoadedTree::PutRows<double>& put,
                                   api::PointReport* report) {
  std::vector<double> distances(std::min(points.size(), kBlockPoints));
  return ForEachBlock(
      points, report,
      [&](std::span<const core::Vec3d> block) {
        return core::FindSignedDistances(scene, block, query,
                                         std::span(distances).first(block.size()));
      },
      [&](std::size_t count) { put(std::span<const double>(distances).first(count)); });
}

core::Status AnswerInside(const core::Scene& scene, const api::PointTable& points,
                          const core::PointOptions& query,
                          const LoadedTree::PutRows<std::int8_t>& put, api::PointReport* report) {
  std::vector<core::Side> sides(std::min(points.size(), kBlockPoints));
  std::vector<std::int8_t> inside(sides.size());
  return ForEachBlock(
      points, report,
      [&](std::span<const core::Vec3d> block) {
        return core::FindSides(scene, block, query, std::span(sides).first(block.size()));
      },
      [&](std::size_t count) {
        for (std::size_t i = 0; i < count; ++i) inside[i] = static_cast<std::int8_t>(sides[i]);
        put(std::span<const std::int8_t>(inside).first(count));
      });
}

}  // namespace kdray::server
