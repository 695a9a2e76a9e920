// SPDX-License-Identifier: Apache-2.0
// Rays a second beside Embree: kdray's kernels and ten modes of Embree (quality MEDIUM and HIGH;
// single rays, packets of 16 and streams, coherent and incoherent), without and with ROBUST, taken
// in turn in one process on the same rays.
//
// Options: --mesh NAME (may be repeated), --build NAME (kd-sah), --runs N, --side PIXELS, --threads
// N, --csv FILE,
// --kernels (also each kernel alone, to see what the choice costs), --quick (Embree's MEDIUM only).
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "core/base/parallel.h"
#include "core/scene/scene.h"
#include "core/trace/trace.h"
#include "tests/bench/embree_modes.h"
#include "tests/bench/scenes.h"

namespace kdray::bench {
namespace {

using core::Hit;
using core::Precision;
using core::RayF;

struct Options {
  std::vector<std::string> meshes;
  int runs = 7;
  int side = 512;
  int threads = 1;
  core::BuildKind build = core::BuildKind::kKdSah;
  std::string csv;
  std::string rays;  // only the classes whose names contain it
  bool kernels = false;
  bool quick = false;
};

class KdrayMode {
 public:
  KdrayMode(std::string name, const core::Scene& scene, core::TraceOptions options)
      : name_(std::move(name)), scene_(scene), options_(options) {}

  const std::string& name() const { return name_; }
  double Run(const BenchRays& batch, int threads) {
    hits_.resize(batch.any ? 0 : batch.rays.size());
    occluded_.resize(batch.any ? batch.rays.size() : 0);
    const std::span<const RayF> rays(batch.rays);
    const Stopwatch watch(threads);
    const core::Status status = batch.any ? core::TraceAny(scene_, rays, options_, occluded_)
                                          : core::TraceClosest(scene_, rays, options_, hits_);
    const double seconds = watch.seconds();
    if (!status.ok()) std::exit(1);
    return seconds;
  }
  double Distance(std::size_t i) const {
    if (hits_.empty()) return occluded_[i] != 0 ? 0 : kMiss;
    return hits_[i].IsHit() ? hits_[i].t : kMiss;
  }

 private:
  std::string name_;
  const core::Scene& scene_;
  core::TraceOptions options_;
  std::vector<Hit> hits_;
  std::vector<std::uint8_t> occluded_;
};

struct Mismatches {
  std::size_t hit_or_miss = 0, distance = 0;
};
Mismatches Compare(const KdrayMode& ours, const EmbreeMode& robust, std::size_t size) {
  Mismatches found;
  for (std::size_t i = 0; i < size; ++i) {
    const double a = ours.Distance(i);
    const double b = robust.Distance(i);
    if (!IsMismatch(a, b)) continue;
    ++(std::isinf(a) != std::isinf(b) ? found.hit_or_miss : found.distance);
  }
  return found;
}

class Report {
 public:
  explicit Report(const Options& options) {
    if (options.csv.empty()) return;
    csv_ = std::fopen(options.csv.c_str(), "w");
    if (csv_ == nullptr) {
      std::fprintf(stderr, "cannot write %s\n", options.csv.c_str());
      std::exit(2);
    }
    std::fprintf(csv_, "mesh,class,threads,mode,mrays_median,mrays_low,mrays_high,miss,distance\n");
  }
  ~Report() {
    if (csv_ != nullptr) std::fclose(csv_);
  }
  Report(const Report&) = delete;
  Report& operator=(const Report&) = delete;
  void Row(const std::string& mesh, const std::string& rays, int threads, const std::string& mode,
           const Spread& s, const Mismatches* mismatches) {
    if (csv_ == nullptr) return;
    std::fprintf(csv_, "%s,\"%s\",%d,%s,%.3f,%.3f,%.3f,", mesh.c_str(), rays.c_str(), threads,
                 mode.c_str(), s.median, s.low, s.high);
    if (mismatches != nullptr) {
      std::fprintf(csv_, "%zu,%zu\n", mismatches->hit_or_miss, mismatches->distance);
    } else {
      std::fprintf(csv_, ",\n");
    }
    std::fflush(csv_);
  }

 private:
  std::FILE* csv_ = nullptr;
};

void RunMesh(const std::string& name, const Options& options, Report* report) {
  std::fprintf(stderr, "%s: loading\n", name.c_str());
  const BenchMesh bench = LoadBenchMesh(name);
  const auto mesh =
      std::make_shared<const core::TriangleMesh>(core::TriangleMesh::Create(bench.data).value());
  const auto tree =
      std::make_shared<const core::Tree>(core::BuildTree(*mesh, options.build).value());
  const core::Scene scene{mesh, tree};
  const std::vector<BenchRays> classes = MakeRayClasses(*mesh, bench, options.side);

  std::fprintf(stderr, "%s: building for Embree\n", name.c_str());
  std::vector<std::unique_ptr<EmbreeScene>> scenes;
  std::vector<EmbreeMode> embree;
  std::size_t judge = 0;  // the mode that mismatches are counted against
  std::size_t first_robust = 0;
  for (const bool robust : {false, true}) {
    if (robust) first_robust = embree.size();
    for (const auto quality : {RTC_BUILD_QUALITY_MEDIUM, RTC_BUILD_QUALITY_HIGH}) {
      if (options.quick && quality == RTC_BUILD_QUALITY_HIGH) continue;
      scenes.push_back(std::make_unique<EmbreeScene>(bench.data, quality, robust, options.threads));
      const std::string prefix = std::string(robust ? "robust " : "") +
                                 (quality == RTC_BUILD_QUALITY_MEDIUM ? "medium " : "high ");
      if (robust && quality == RTC_BUILD_QUALITY_MEDIUM) judge = embree.size();
      embree.emplace_back(prefix + "single", *scenes.back(), Way::kSingle, false);
      for (const bool coherent : {true, false}) {
        const std::string how = coherent ? "coherent" : "incoherent";
        embree.emplace_back(prefix + "packet " + how, *scenes.back(), Way::kPacket, coherent);
        embree.emplace_back(prefix + "stream " + how, *scenes.back(), Way::kStream, coherent);
      }
    }
  }
  std::vector<KdrayMode> ours;
  for (const Precision precision : core::kAllPrecisions) {
    ours.emplace_back("kdray " + std::string(core::Name(precision)), scene,
                      core::TraceOptions{precision, {}});
  }
  if (options.kernels) {
    for (const core::KernelKind kernel : core::kAllKernelKinds) {
      for (const bool sort : {false, true}) {
        core::TraceOptions forced{Precision::kFast, {}};
        forced.kernel = kernel;
        forced.sort = sort;
        ours.emplace_back("kdray fast " + std::string(core::Name(kernel)) + (sort ? " sorted" : ""),
                          scene, forced);
      }
    }
  }

  std::printf("\n### %s: %zu triangles, %d thread%s\n\n", name.c_str(), mesh->triangle_count(),
              options.threads, options.threads == 1 ? "" : "s");
  std::printf(
      "%s: %.1f bytes a triangle (nodes and leaf blocks); Embree MEDIUM: %.1f.\n\n",
      std::string(Name(options.build)).c_str(),
      static_cast<double>(tree->bytes()) / static_cast<double>(mesh->triangle_count()),
      static_cast<double>(scenes.front()->bytes()) / static_cast<double>(mesh->triangle_count()));
  std::printf(
      "| rays | best Embree | Mrays/s | fast | ratio | best Embree ROBUST | Mrays/s | watertight | "
      "ratio | double | exact | mismatches a million: fast, watertight, double, exact |\n"
      "|---|---|---|---|---|---|---|---|---|---|---|---|\n");
  for (const BenchRays& batch : classes) {
    if (batch.name.find(options.rays) == std::string::npos) continue;
    const double millions = static_cast<double>(batch.rays.size()) * 1e-6;
    std::vector<std::vector<double>> embree_speed(embree.size()), our_speed(ours.size());
    for (EmbreeMode& mode : embree) mode.Prepare(batch);
    for (int run = 0; run < options.runs; ++run) {
      // The two sides in turn, so that a disturbance meets both.
      for (std::size_t m = 0; m < std::max(embree.size(), ours.size()); ++m) {
        if (m < ours.size()) our_speed[m].push_back(millions / ours[m].Run(batch, options.threads));
        if (m < embree.size()) embree_speed[m].push_back(millions / embree[m].Run(options.threads));
      }
    }
    std::vector<Spread> embree_spread, our_spread;
    for (auto& speeds : embree_speed) embree_spread.push_back(SpreadOf(std::move(speeds)));
    for (auto& speeds : our_speed) our_spread.push_back(SpreadOf(std::move(speeds)));
    std::vector<Mismatches> mismatches;
    for (const KdrayMode& mode : ours) {
      mismatches.push_back(Compare(mode, embree[judge], batch.rays.size()));
    }
    const auto best = [&](std::size_t first, std::size_t last) {
      std::size_t found = first;
      for (std::size_t m = first; m < last; ++m) {
        if (embree_spread[m].median > embree_spread[found].median) found = m;
      }
      return found;
    };
    const std::size_t plain = best(0, first_robust);
    const std::size_t robust = best(first_robust, embree.size());
    std::printf("| %s | %s | %.1f | %.1f | **%.2f** | %s | %.1f | %.1f | **%.2f** | %.1f | %.1f |",
                batch.name.c_str(), embree[plain].name().c_str(), embree_spread[plain].median,
                our_spread[0].median, our_spread[0].median / embree_spread[plain].median,
                embree[robust].name().c_str(), embree_spread[robust].median, our_spread[1].median,
                our_spread[1].median / embree_spread[robust].median, our_spread[2].median,
                our_spread[3].median);
    for (std::size_t m = 0; m < core::kAllPrecisions.size(); ++m) {
      std::printf("%s %.0f + %.0f", m == 0 ? "" : ",",
                  static_cast<double>(mismatches[m].hit_or_miss) / millions,
                  static_cast<double>(mismatches[m].distance) / millions);
    }
    std::printf(" |\n");
    for (std::size_t m = core::kAllPrecisions.size(); m < ours.size(); ++m) {
      std::fprintf(stderr, "  %-24s %-28s %.1f\n", batch.name.c_str(), ours[m].name().c_str(),
                   our_spread[m].median);
    }
    std::fflush(stdout);
    for (std::size_t m = 0; m < ours.size(); ++m) {
      report->Row(name, batch.name, options.threads, ours[m].name(), our_spread[m], &mismatches[m]);
    }
    for (std::size_t m = 0; m < embree.size(); ++m) {
      report->Row(name, batch.name, options.threads, "embree " + embree[m].name(), embree_spread[m],
                  nullptr);
      embree[m].Release();
    }
  }
}

int Main(int argc, char** argv) {
  Options options;
  for (int i = 1; i < argc; ++i) {
    const std::string name = argv[i];
    const auto value = [&] {
      if (i + 1 == argc) {
        std::fprintf(stderr, "%s needs a value\n", name.c_str());
        std::exit(2);
      }
      return std::string(argv[++i]);
    };
    if (name == "--mesh") {
      options.meshes.push_back(value());
    } else if (name == "--build") {
      const std::string build = value();
      if (const auto kind = core::ParseBuildKind(build)) {
        options.build = *kind;
      } else {
        std::fprintf(stderr, "no such build: %s\n", build.c_str());
        return 2;
      }
    } else if (name == "--runs") {
      options.runs = std::atoi(value().c_str());
    } else if (name == "--side") {
      options.side = std::atoi(value().c_str()) / 8 * 8;
    } else if (name == "--threads") {
      options.threads = std::atoi(value().c_str());
    } else if (name == "--csv") {
      options.csv = value();
    } else if (name == "--rays") {
      options.rays = value();
    } else if (name == "--kernels") {
      options.kernels = true;
    } else if (name == "--quick") {
      options.quick = true;
    } else {
      std::fprintf(stderr, "no such option: %s\n", name.c_str());
      return 2;
    }
  }
  if (options.runs < 1 || options.side < 8 || options.threads < 1) {
    std::fprintf(stderr, "--runs and --threads are at least 1, --side at least 8\n");
    return 2;
  }
  if (options.meshes.empty()) {
    options.meshes = {"bunny_69k",         "igea_268k", "classroom_inside", "office",
                      "classroom_outside", "scan_1m",   "scan_4m"};
  }
  std::printf("%s; %d runs, medians; %dx%d pixels; SIMD %s\n", MachineLine().c_str(), options.runs,
              options.side, options.side, std::string(Name(core::BestSimdLevel())).c_str());
  Report report(options);
  core::Arena arena(options.threads);
  for (const std::string& mesh : options.meshes) {
    arena.Run([&] { RunMesh(mesh, options, &report); });
  }
  return 0;
}

}  // namespace
}  // namespace kdray::bench

int main(int argc, char** argv) { return kdray::bench::Main(argc, argv); }
