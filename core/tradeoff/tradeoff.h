// SPDX-License-Identifier: Apache-2.0
// Measures speed and accuracy on one mesh: every build with every precision.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "core/accel/build_kind.h"
#include "core/base/cancel.h"
#include "core/base/progress.h"
#include "core/base/result.h"
#include "core/geometry/triangle_mesh.h"
#include "core/intersect/precision.h"

namespace kdray::core {

/// The number of wrong rays among all rays of a kind.
struct ErrorRate {
  std::uint64_t count = 0;
  std::uint64_t rays = 0;

  double rate() const {
    return rays == 0 ? 0.0 : static_cast<double>(count) / static_cast<double>(rays);
  }
  /// If no ray was wrong, the upper bound of the true rate with 95% confidence: 3 / rays ("rule of
  /// three"; 1 without a ray). Otherwise nullopt.
  std::optional<double> bound() const {
    if (count != 0) return std::nullopt;
    return rays <= 3 ? 1.0 : 3.0 / static_cast<double>(rays);
  }
  friend bool operator==(const ErrorRate&, const ErrorRate&) = default;
};

/// |t - exact t| * |cos| / (|t| + extent / |d|), which is at most PrecisionTraits::t_error: at
/// grazing incidence and near the origin nothing bounds the error relative to t itself.
/// Dimensionless. extent is the longest side of the mesh's bounds, d the ray's direction, cos that
/// between d and the normal of the triangle that was named. Over rays for which both found the same
/// triangle or two that share an edge, without folds.
struct TError {
  std::uint64_t rays = 0;
  double p999 = 0;  ///< 999 of 1000 are at most this
  double max = 0;
  friend bool operator==(const TError&, const TError&) = default;
};

/// One precision compared with `exact`, on aimed rays. It does not depend on the build.
struct Accuracy {
  Precision precision = Precision::kExact;
  /// Rays from strictly inside a closed mesh that miss it. nullopt if the mesh is not closed, or no
  /// point inside it was found.
  std::optional<ErrorRate> leaks;
  ErrorRate wrong_triangles;        ///< another triangle than the exact one, mostly its neighbour
  ErrorRate unconnected_triangles;  ///< those of them that share no corner with it
  /// Of those, rays past a fold of the surface: the nearer of the two hits lies within rounding (a
  /// pad, core/geometry/local_ray.h) of its triangle's border, so in one arithmetic the ray touches
  /// the fold, and in the other it passes to the surface beyond.
  ErrorRate folds;
  ErrorRate missed_hits;  ///< a miss instead of an exact hit
  ErrorRate extra_hits;   ///< a hit instead of an exact miss
  TError t_error;
  friend bool operator==(const Accuracy&, const Accuracy&) = default;
};

/// Rays a second on all threads together: the median run, and the extremes.
struct Speed {
  double rays_per_s = 0;
  double slowest = 0, fastest = 0;
  friend bool operator==(const Speed&, const Speed&) = default;
};

/// Average work of one ray.
struct Steps {
  std::uint64_t rays = 0;  ///< that were counted
  double nodes = 0;
  double triangles = 0;
  friend bool operator==(const Steps&, const Steps&) = default;
};

struct MeasuredBuild {
  BuildKind build = BuildKind::kBox;
  double build_ms = 0;
  std::uint64_t bytes = 0;  ///< of the tree, without the mesh
  double sah_cost = 0;      ///< TreeStats::sah_cost
  Steps random, aimed;      ///< in the precision `watertight`
  friend bool operator==(const MeasuredBuild&, const MeasuredBuild&) = default;
};

struct MeasuredPair {
  BuildKind build = BuildKind::kBox;
  Precision precision = Precision::kExact;
  Speed random, aimed;
  /// Aimed rays whose answer differed in a bit from that of the first build; must be 0.
  ErrorRate differences;
  friend bool operator==(const MeasuredPair&, const MeasuredPair&) = default;
};

struct Tradeoff {
  std::uint64_t triangles = 0;
  bool closed = false;
  bool from_inside = false;  ///< aimed rays start strictly inside the mesh
  std::uint64_t seed = 0;
  int threads = 0;
  double load_average = 0;           ///< TradeoffOptions::load_average
  std::uint64_t runs = 0;            ///< timed runs, over all pairs
  std::uint64_t disturbed_runs = 0;  ///< those of them during which other work ran
  double total_ms = 0;
  std::vector<Accuracy> precisions;   ///< in the order asked
  std::vector<MeasuredBuild> builds;  ///< in the order asked
  std::vector<MeasuredPair> pairs;    ///< build by build
  friend bool operator==(const Tradeoff&, const Tradeoff&) = default;
};

struct TradeoffOptions {
  std::vector<BuildKind> builds = {kAllBuildKinds.begin(), kAllBuildKinds.end()};
  std::vector<Precision> precisions = {kAllPrecisions.begin(), kAllPrecisions.end()};
  std::uint64_t seed = 1;
  std::size_t rays = std::size_t{1} << 16;  ///< at most, of each kind; more find rarer errors
  int runs = 3;                             ///< of each pair and kind of rays
  /// For all tracing, without building. Slow pairs (`box` on a large mesh) trace fewer rays.
  std::chrono::milliseconds trace_time{8000};
  int threads = 1;          ///< of the caller's arena
  double load_average = 0;  ///< of the machine before the measurement; only copied to the result
  /// Whether other work runs now, which makes times larger; empty: never. Called before and after
  /// each run.
  std::function<bool()> is_disturbed;
};

/// Builds every structure over `mesh` in turn, in the caller's arena, and traces random rays
/// (between points of a sphere around the mesh and points of its bounds) and aimed ones (at
/// vertices, at edges, within planes through vertices; from strictly inside a closed mesh).
/// `closed` is MeshHealth::closed. Errors: those of BuildTree; kCancelled, kDeadlineExceeded. Times
/// differ from run to run; everything else depends on the mesh, the seed and the number of rays
/// traced in the time.
Result<Tradeoff> MeasureTradeoff(const std::shared_ptr<const TriangleMesh>& mesh, bool closed,
                                 const TradeoffOptions& options, const CancelToken& cancel,
                                 Progress* progress = nullptr);

/// Upper bound of the memory that MeasureTradeoff holds at its peak, without the mesh.
std::uint64_t EstimateTradeoffBytes(std::size_t triangle_count, const TradeoffOptions& options);

}  // namespace kdray::core
