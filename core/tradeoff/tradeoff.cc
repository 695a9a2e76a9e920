// SPDX-License-Identifier: Apache-2.0
#include "core/tradeoff/tradeoff.h"

#include <algorithm>
#include <array>
#include <bit>
#include <span>
#include <utility>

#include "core/base/elapsed.h"
#include "core/scene/scene.h"
#include "core/trace/trace.h"
#include "core/tradeoff/accuracy_judge.h"
#include "core/tradeoff/ray_sets.h"
#include "core/tradeoff/speed_meter.h"

namespace kdray::core {
namespace {

using SteadyClock = std::chrono::steady_clock;

// Shares of the time for tracing. Rare errors need many rays, while a speed is accurate after some
// milliseconds.
constexpr double kJudgingShare = 0.3;
constexpr double kSteppingShare = 0.1;
constexpr double kTimingShare = 1 - kJudgingShare - kSteppingShare;

// The share of an accuracy in the whole, for the progress; the builds have the rest.
constexpr double kJudgingProgress = 0.2;

// Rays of a batch that is not timed: at first few, so one batch is quick in any structure; in the
// end enough for every thread.
constexpr std::size_t kFirstBatch = 64;
constexpr std::size_t kRaysPerThread = 4096;

bool SameBits(const Hit& a, const Hit& b) {
  const auto same = [](double x, double y) {
    return std::bit_cast<std::uint64_t>(x) == std::bit_cast<std::uint64_t>(y);
  };
  return a.primitive_id == b.primitive_id && same(a.t, b.t) && same(a.u, b.u) && same(a.v, b.v);
}

/// One measurement from start to end.
class Measuring {
 public:
  Measuring(std::shared_ptr<const TriangleMesh> mesh, bool closed, const TradeoffOptions& options,
            const CancelToken& cancel, Progress* progress)
      : mesh_(std::move(mesh)), options_(options), cancel_(cancel), progress_(progress) {
    result_.triangles = mesh_->triangle_count();
    result_.closed = closed;
    result_.seed = options.seed;
    result_.threads = options.threads;
    result_.load_average = options.load_average;
  }

  Result<Tradeoff> Run() {
    const auto start = SteadyClock::now();
    random_rays_ = RandomRays(*mesh_, options_.rays, options_.seed);
    for (const BuildKind build : options_.builds) {
      if (Status status = MeasureBuild(build); !status.ok()) return std::move(status).error();
    }
    result_.total_ms = MillisecondsSince(start);
    if (progress_ != nullptr) progress_->Finish();
    return std::move(result_);
  }

 private:
  Status MeasureBuild(BuildKind kind) {
    const auto start = SteadyClock::now();
    Result<Tree> tree = BuildTree(*mesh_, kind, BuildOptions{cancel_});
    if (!tree.ok()) return std::move(tree).error();
    MeasuredBuild measured;
    measured.build = kind;
    measured.build_ms = MillisecondsSince(start);
    measured.bytes = tree->bytes();
    measured.sah_cost = tree->stats.sah_cost;
    const Scene scene{mesh_, std::make_shared<const Tree>(*std::move(tree))};
    Advance(BuildProgress() / 2);

    if (result_.builds.empty()) {
      if (Status status = Judge(scene); !status.ok()) return status;
    }
    if (Status status = CountSteps(scene, random_rays_, &measured.random); !status.ok()) {
      return status;
    }
    if (Status status = CountSteps(scene, aimed_.rays, &measured.aimed); !status.ok()) {
      return status;
    }
    result_.builds.push_back(measured);
    return Time(scene, kind);
  }

  // Accuracy does not depend on the build, so it is measured on the first one. The others are only
  // checked to give the same answers.
  Status Judge(const Scene& scene) {
    Result<AimedRays> aimed =
        MakeAimedRays(scene, result_.closed, options_.rays, options_.seed + 1, cancel_);
    if (!aimed.ok()) return std::move(aimed).error();
    aimed_ = *std::move(aimed);
    result_.from_inside = aimed_.from_inside;

    std::vector<AccuracyJudge> judges;
    for (const Precision precision : options_.precisions) {
      judges.emplace_back(*mesh_, precision, aimed_.from_inside);
    }
    answers_.assign(options_.precisions.size(), {});
    const auto end = SteadyClock::now() + Share(kJudgingShare);
    const std::span<const Ray> rays(aimed_.rays);
    std::vector<Hit> exact, hits;
    std::size_t first = 0;
    while (first < rays.size() && (first == 0 || SteadyClock::now() < end)) {
      const auto some = rays.subspan(first, NextBatch(first));
      first += some.size();
      exact.resize(some.size());
      hits.resize(some.size());
      if (Status status = Trace(scene, some, Precision::kExact, exact); !status.ok()) return status;
      for (std::size_t i = 0; i < judges.size(); ++i) {
        Status status = Trace(scene, some, options_.precisions[i], hits);
        if (!status.ok()) return status;
        judges[i].Add(some, exact, hits);
        answers_[i].insert(answers_[i].end(), hits.begin(), hits.end());
      }
    }
    for (const AccuracyJudge& judge : judges) result_.precisions.push_back(judge.Sum());
    Advance(kJudgingProgress);
    return {};
  }

  Status Trace(const Scene& scene, std::span<const Ray> rays, Precision precision,
               std::span<Hit> hits) const {
    return TraceClosest(scene, rays, {precision, cancel_}, hits);
  }

  Status CountSteps(const Scene& scene, std::span<const Ray> rays, Steps* steps) const {
    const double parts = 2.0 * static_cast<double>(options_.builds.size());
    const auto end = SteadyClock::now() + Share(kSteppingShare / parts);
    std::uint64_t nodes = 0, triangles = 0;
    std::vector<Hit> hits;
    std::vector<TraceCost> costs;
    std::size_t first = 0;
    while (first < rays.size() && (first == 0 || SteadyClock::now() < end)) {
      const std::size_t count = NextBatch(first);
      hits.resize(count);
      costs.resize(count);
      Status status = TraceCostly(scene, rays.subspan(first, count),
                                  {Precision::kWatertight, cancel_}, hits, costs);
      if (!status.ok()) return status;
      for (const TraceCost& cost : costs) {
        nodes += cost.nodes_visited;
        triangles += cost.triangles_tested;
      }
      first += count;
    }
    steps->rays = first;
    if (first == 0) return {};
    steps->nodes = static_cast<double>(nodes) / static_cast<double>(first);
    steps->triangles = static_cast<double>(triangles) / static_cast<double>(first);
    return {};
  }

  // The precisions alternate, so a machine that slows down slows all of them.
  Status Time(const Scene& scene, BuildKind kind) {
    struct Meters {
      SpeedMeter random, aimed;
    };
    std::vector<Meters> meters;
    for (const Precision precision : options_.precisions) {
      meters.push_back({SpeedMeter(scene, random_rays_, precision, options_.threads),
                        SpeedMeter(scene, aimed_.rays, precision, options_.threads)});
    }
    const double runs = static_cast<double>(options_.builds.size() * meters.size() * 2) *
                        std::max(options_.runs, 1);
    const auto time = Share(kTimingShare / runs);
    for (int run = 0; run < options_.runs; ++run) {
      for (Meters& pair : meters) {
        for (SpeedMeter* meter : {&pair.random, &pair.aimed}) {
          const bool before = IsDisturbed();
          if (Status status = meter->Run(time, cancel_); !status.ok()) return status;
          ++result_.runs;
          if (before || IsDisturbed()) ++result_.disturbed_runs;
        }
      }
      Advance(BuildProgress() / 2 / options_.runs);
    }
    for (std::size_t i = 0; i < meters.size(); ++i) {
      result_.pairs.push_back({kind, options_.precisions[i], meters[i].random.Sum(),
                               meters[i].aimed.Sum(),
                               Differences(answers_[i], meters[i].aimed.hits())});
    }
    return {};
  }

  static ErrorRate Differences(std::span<const Hit> expected, std::span<const Hit> hits) {
    ErrorRate rate;
    rate.rays = std::min(expected.size(), hits.size());
    for (std::size_t i = 0; i < rate.rays; ++i)
      rate.count += SameBits(expected[i], hits[i]) ? 0 : 1;
    return rate;
  }

  /// Size of the batch after `done` rays: as large as all before, so no batch exceeds the time by
  /// much.
  std::size_t NextBatch(std::size_t done) const {
    const std::size_t most = kRaysPerThread * static_cast<std::size_t>(options_.threads);
    return std::min(std::clamp(done, kFirstBatch, most), options_.rays - done);
  }

  bool IsDisturbed() const { return options_.is_disturbed && options_.is_disturbed(); }
  std::chrono::nanoseconds Share(double share) const {
    return std::chrono::duration_cast<std::chrono::nanoseconds>(options_.trace_time * share);
  }
  double BuildProgress() const {
    return (1 - kJudgingProgress) / static_cast<double>(options_.builds.size());
  }
  void Advance(double fraction) {
    if (progress_ != nullptr) progress_->Add(fraction);
  }

  const std::shared_ptr<const TriangleMesh> mesh_;
  const TradeoffOptions& options_;
  const CancelToken& cancel_;
  Progress* const progress_;
  std::vector<Ray> random_rays_;
  AimedRays aimed_;
  std::vector<std::vector<Hit>> answers_;  // of the first build on aimed rays, by precision
  Tradeoff result_;
};

}  // namespace

Result<Tradeoff> MeasureTradeoff(const std::shared_ptr<const TriangleMesh>& mesh, bool closed,
                                 const TradeoffOptions& options, const CancelToken& cancel,
                                 Progress* progress) {
  return Measuring(mesh, closed, options, cancel, progress).Run();
}

std::uint64_t EstimateTradeoffBytes(std::size_t triangle_count, const TradeoffOptions& options) {
  std::uint64_t build_bytes = 0;
  for (const BuildKind build : options.builds) {
    build_bytes = std::max(build_bytes, EstimateBuildBytes(triangle_count, build));
  }
  // Two sets of rays; for each precision the first build's hits, those of two meters, and errors
  // of t, twice while they are sorted; costs and hits of the rays whose steps are counted.
  const std::uint64_t precisions = options.precisions.size();
  const std::uint64_t ray_bytes = 2 * sizeof(Ray) +
                                  precisions * (3 * sizeof(Hit) + 2 * sizeof(double)) +
                                  sizeof(Hit) + sizeof(TraceCost);
  return build_bytes + options.rays * ray_bytes;
}

}  // namespace kdray::core
