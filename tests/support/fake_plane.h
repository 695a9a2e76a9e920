// SPDX-License-Identifier: Apache-2.0
// The tree of FakeBackend: the plane z = 0, which answers every query without geometry.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <functional>
#include <limits>
#include <optional>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

#include "server/backend.h"

namespace kdray::test {

/// The time that queries take. They run while `hold` is true, and end early when they are
/// cancelled.
class FakeWork {
 public:
  std::atomic<bool> hold{false};
  std::atomic<int> running{0}, most_running{0}, cancelled{0}, renders{0};
  /// What queries are refused with.
  std::optional<api::Problem> query_problem;

  /// Spends the time of a query.
  api::Check Do(const server::CancelToken& cancel) {
    if (query_problem) return *query_problem;
    const int now = ++running;
    for (int most = most_running; most < now && !most_running.compare_exchange_weak(most, now);) {
    }
    while (hold && !cancel.ShouldStop()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    --running;
    if (!cancel.ShouldStop()) return std::nullopt;
    ++cancelled;
    return api::Problem{.code = cancel.Reason() == core::ErrorCode::kCancelled
                                    ? api::ErrorCode::kDraining
                                    : api::ErrorCode::kDeadlineExceeded,
                        .detail = "out of time"};
  }
};

class FakePlane final : public server::LoadedTree {
 public:
  explicit FakePlane(FakeWork& work) : work_(work) {}

  std::uint64_t bytes() const override { return 0; }

  api::Outcome<api::BatchReport> Closest(const api::RayTable& rays, const api::RayOptions& options,
                                         const server::CancelToken& cancel,
                                         api::RowSink<api::ClosestRows>* sink) const override {
    if (auto problem = work_.Do(cancel)) return *std::move(problem);
    constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
    constexpr double kInfinity = std::numeric_limits<double>::infinity();
    api::BatchReport report = Report(options, api::Precision::kWatertight);
    std::vector<api::RayHit> hits;
    for (const auto& [t, valid] : Planes(rays, &report)) {
      hits.push_back({!valid ? kNan : t >= 0 ? t : kInfinity, 0, 0, t >= 0 ? 0 : -1});
    }
    const Details details(hits.size());
    if (auto problem = sink->Begin(hits.size())) return *std::move(problem);
    sink->Put({.first_row = 0, .hits = details.Of(hits)});
    return report;
  }

  api::Outcome<api::BatchReport> Any(const api::RayTable& rays, const api::RayOptions& options,
                                     const server::CancelToken& cancel,
                                     api::RowSink<api::AnyRows>* sink) const override {
    if (auto problem = work_.Do(cancel)) return *std::move(problem);
    api::BatchReport report = Report(options, api::Precision::kWatertight);
    std::vector<std::uint8_t> occluded;
    for (const auto& plane : Planes(rays, &report)) occluded.push_back(plane.first >= 0 ? 1 : 0);
    if (auto problem = sink->Begin(occluded.size())) return *std::move(problem);
    sink->Put({.first_row = 0, .occluded = occluded});
    return report;
  }

  api::Outcome<api::BatchReport> Count(const api::RayTable& rays, const api::RayOptions& options,
                                       const server::CancelToken& cancel,
                                       api::RowSink<api::CountRows>* sink) const override {
    if (auto problem = work_.Do(cancel)) return *std::move(problem);
    api::BatchReport report = Report(options, api::Precision::kExact);
    std::vector<std::uint32_t> counts;
    for (const auto& plane : Planes(rays, &report)) counts.push_back(plane.first >= 0 ? 1 : 0);
    if (auto problem = sink->Begin(counts.size())) return *std::move(problem);
    sink->Put({.first_row = 0, .counts = counts});
    return report;
  }

  /// Every hit is there twice, and the second is cut off if max_hits is 1.
  api::Outcome<api::BatchReport> All(const api::RayTable& rays, const api::RayOptions& options,
                                     const server::CancelToken& cancel,
                                     api::RowSink<api::AllRows>* sink) const override {
    if (auto problem = work_.Do(cancel)) return *std::move(problem);
    api::BatchReport report = Report(options, api::Precision::kExact);
    std::vector<api::RayHit> hits;
    std::vector<std::uint32_t> counts;
    for (const auto& plane : Planes(rays, &report)) {
      counts.push_back(plane.first < 0 ? 0 : options.max_hits == 1 ? 1 : 2);
      if (counts.back() == 1) report.truncated.push_back(counts.size() - 1);
      for (std::uint32_t i = 0; i < counts.back(); ++i) {
        hits.push_back({plane.first, 0, 0, static_cast<std::int32_t>(i)});
      }
    }
    const Details details(hits.size());
    if (auto problem = sink->Begin(hits.size())) return *std::move(problem);
    sink->Put({.first_row = 0, .first_hit = 0, .counts = counts, .hits = details.Of(hits)});
    return report;
  }

  void RunPieces(std::size_t count, const std::function<void(std::size_t)>& piece) const override {
    for (std::size_t i = 0; i < count; ++i) piece(i);
  }

  api::Outcome<api::PointReport> ClosestPoints(
      const api::PointTable& points, const api::PointOptions&, const server::CancelToken& cancel,
      const PutRows<api::NearestPoint>& put) const override {
    constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
    return PutPoints<api::NearestPoint>(
        points, cancel, put, [](const api::Vec3& p, bool valid) -> api::NearestPoint {
          if (!valid) return {kNan, {kNan, kNan, kNan}, {kNan, kNan, kNan}, 0, 0, -1};
          return {std::abs(p[2]), {p[0], p[1], 0}, {0, 0, 1}, 0, 0, 0};
        });
  }
  api::Outcome<api::PointReport> SignedDistances(const api::PointTable& points,
                                                 const api::PointOptions&,
                                                 const server::CancelToken& cancel,
                                                 const PutRows<double>& put) const override {
    return PutPoints<double>(points, cancel, put, [](const api::Vec3& p, bool valid) {
      return valid ? p[2] : std::numeric_limits<double>::quiet_NaN();
    });
  }
  api::Outcome<api::PointReport> Inside(const api::PointTable& points, const api::PointOptions&,
                                        const server::CancelToken& cancel,
                                        const PutRows<std::int8_t>& put) const override {
    return PutPoints<std::int8_t>(points, cancel, put, [](const api::Vec3& p, bool valid) {
      return static_cast<std::int8_t>(!valid ? -1 : p[2] <= 0 ? 1 : 0);
    });
  }

  /// Points on different sides of the plane do not see each other.
  api::Outcome<api::VisibilityAnswer> Visibility(const api::PointSets& sets,
                                                 const api::VisibilityOptions& options,
                                                 const server::CancelToken& cancel) const override {
    if (auto problem = work_.Do(cancel)) return *std::move(problem);
    api::VisibilityAnswer answer;
    answer.precision = api::Precision::kWatertight;
    if (!options.t_min) answer.offset = 0.25;
    const std::size_t row = options.bits ? (sets.to.size() + 7) / 8 : sets.to.size();
    answer.visible.assign(sets.from.size() * row, 0);
    for (std::size_t i = 0; i < sets.from.size(); ++i) {
      for (std::size_t j = 0; j < sets.to.size(); ++j) {
        if (sets.from[i][2] * sets.to[j][2] < 0) continue;
        if (options.bits) {
          answer.visible[i * row + j / 8] |= static_cast<std::uint8_t>(0x80u >> (j % 8));
        } else {
          answer.visible[i * row + j] = 1;
        }
      }
    }
    return answer;
  }

  api::Outcome<api::RenderAnswer> Render(const api::RenderRequest& request, bool png,
                                         const server::CancelToken& cancel) const override {
    if (auto problem = work_.Do(cancel)) return *std::move(problem);
    ++work_.renders;
    api::RenderAnswer answer;
    answer.precision = api::Precision::kWatertight;
    answer.samples = 3;
    answer.depth_range = request.depth_range;
    if (request.max_noise) answer.noise = 0.25;
    if (request.budget_ms) answer.stopped = api::Stopped::kBudget;
    if (png) {
      constexpr std::string_view kPng = "\x89PNG\r\n\x1a\n";
      std::vector<std::byte> bytes(kPng.size());
      std::memcpy(bytes.data(), kPng.data(), kPng.size());
      answer.image = std::move(bytes);
    } else {
      api::ImageArray image;
      image.width = static_cast<std::size_t>(request.width);
      image.height = static_cast<std::size_t>(request.height);
      image.values = std::vector<float>(image.width * image.height, 1.0F);
      answer.image = std::move(image);
    }
    return answer;
  }

  api::Outcome<std::vector<api::Cell>> Cells(std::uint32_t depth,
                                             const server::CancelToken& cancel) const override {
    if (auto problem = work_.Do(cancel)) return *std::move(problem);
    if (depth > 30) {
      return api::Problem{.code = api::ErrorCode::kTooManyCells, .detail = "too many cells"};
    }
    return std::vector<api::Cell>{
        {.bounds = {{0, 0, 0}, {1, 1, 1}}, .depth = depth, .leaf = true, .triangles = 1}};
  }

 private:
  static api::BatchReport Report(const api::RayOptions& options, api::Precision precision) {
    api::BatchReport report;
    report.precision = precision;
    report.trace_ms = 0.5;
    if (options.auto_t_min || options.auto_t_max) report.offset = 0.25;
    return report;
  }

  /// The details of hits on z = 0.
  class Details {
   public:
    explicit Details(std::size_t count)
        : normals_(count, {0, 0, 1}),
          points_(count),
          sides_(count, 1),
          groups_(count, 0),
          uvs_(count, {0.25, 0.75}) {}
    api::Hits Of(const std::vector<api::RayHit>& hits) const {
      return {.hits = hits,
              .normals = normals_,
              .points = points_,
              .sides = sides_,
              .groups = groups_,
              .uvs = uvs_,
              .shading_normals = normals_};
    }

   private:
    std::vector<api::Vec3> normals_, points_;
    std::vector<std::int8_t> sides_;
    std::vector<std::int32_t> groups_;
    std::vector<std::array<double, 2>> uvs_;
  };

  /// Distance to z = 0 along each ray (negative: none), and whether the ray is one. Lists invalid
  /// rows.
  static std::vector<std::pair<double, bool>> Planes(const api::RayTable& rays,
                                                     api::BatchReport* report) {
    std::vector<std::pair<double, bool>> planes;
    for (std::size_t row = 0; row < rays.size(); ++row) {
      std::array<double, api::kRayNumbers> n{};
      if (rays.row_type() == api::NumberType::kF4) {
        std::array<float, api::kRayNumbers> narrow{};
        rays.Read(row, narrow);
        std::copy(narrow.begin(), narrow.end(), n.begin());
      } else {
        rays.Read(row, n);
      }
      const double oz = n[2], dz = n[6];
      const bool valid =
          std::isfinite(oz) && std::isfinite(dz) && (n[4] != 0 || n[5] != 0 || dz != 0);
      if (!valid) report->invalid.push_back(row);
      const double t = -oz / dz;
      planes.emplace_back(valid && t >= 0 && std::isfinite(t) ? t : -1, valid);
    }
    return planes;
  }

  template <class Row, class ToRow>
  api::Outcome<api::PointReport> PutPoints(const api::PointTable& points,
                                           const server::CancelToken& cancel,
                                           const PutRows<Row>& put, const ToRow& to_row) const {
    if (auto problem = work_.Do(cancel)) return *std::move(problem);
    api::PointReport report;
    report.precision = api::Precision::kDouble;
    report.trace_ms = 0.5;
    std::vector<Row> rows;
    for (const api::Vec3& p : points.rows) {
      const bool valid = std::isfinite(p[0]) && std::isfinite(p[1]) && std::isfinite(p[2]);
      if (!valid) report.invalid.push_back(rows.size());
      rows.push_back(to_row(p, valid));
    }
    put(rows);
    return report;
  }

  FakeWork& work_;
};

}  // namespace kdray::test
