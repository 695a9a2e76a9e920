// SPDX-License-Identifier: Apache-2.0
// Rays a second beside Embree: kdray's kernels and ten modes of Embree (quality MEDIUM and HIGH;
// single rays, packets of 16 and streams, coherent and incoherent), without and with ROBUST, taken
// in turn in one process on the same rays. The fastest modes also from rows to rows, and pictures.
// Beside the build that is measured, the other one of kd-sah and bvh.
//
// Options: --mesh NAME (may be repeated), --build NAME (auto), --runs N, --side PIXELS, --threads
// N, --csv FILE, --rays PART (only classes whose names contain it; `render` is one),
// --kernels (also each kernel alone, to see what the choice costs), --quick (Embree's MEDIUM only).
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <iterator>
#include <memory>
#include <numeric>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "core/accel/auto_choice.h"
#include "core/accel/expected_cost.h"
#include "core/base/parallel.h"
#include "core/render/renderer.h"
#include "core/scene/scene.h"
#include "core/trace/trace.h"
#include "tests/bench/embree_modes.h"
#include "tests/bench/embree_picture.h"
#include "tests/bench/embree_rows.h"
#include "tests/bench/scenes.h"
#include "tests/bench/trace_report.h"

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
  std::optional<core::BuildKind> build;  // nullopt: auto
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

template <class Mode>
Mismatches Compare(const Mode& ours, const EmbreeMode& robust, std::size_t size) {
  Mismatches found;
  for (std::size_t i = 0; i < size; ++i) {
    const double a = ours.Distance(i);
    const double b = robust.Distance(i);
    if (!IsMismatch(a, b)) continue;
    ++(std::isinf(a) != std::isinf(b) ? found.hit_or_miss : found.distance);
  }
  return found;
}

// The modes of Embree over one mesh.
struct EmbreeSide {
  std::vector<std::unique_ptr<EmbreeScene>> scenes;
  std::vector<EmbreeMode> modes;
  std::vector<EmbreeRows> rows;  // of each mode
  std::size_t judge = 0;         // the mode that mismatches are counted against
  std::size_t first_robust = 0;
};

struct EmbreeWay {
  const char* name;
  Way way;
  bool coherent;
};
constexpr EmbreeWay kEmbreeWays[] = {{"single", Way::kSingle, false},
                                     {"packet coherent", Way::kPacket, true},
                                     {"stream coherent", Way::kStream, true},
                                     {"packet incoherent", Way::kPacket, false},
                                     {"stream incoherent", Way::kStream, false}};

EmbreeSide BuildEmbree(const BenchMesh& bench, const Options& options) {
  EmbreeSide side;
  for (const bool robust : {false, true}) {
    if (robust) side.first_robust = side.modes.size();
    for (const auto quality : {RTC_BUILD_QUALITY_MEDIUM, RTC_BUILD_QUALITY_HIGH}) {
      if (options.quick && quality == RTC_BUILD_QUALITY_HIGH) continue;
      side.scenes.push_back(
          std::make_unique<EmbreeScene>(bench.data, quality, robust, options.threads));
      const std::string prefix = std::string(robust ? "robust " : "") +
                                 (quality == RTC_BUILD_QUALITY_MEDIUM ? "medium " : "high ");
      if (robust && quality == RTC_BUILD_QUALITY_MEDIUM) side.judge = side.modes.size();
      for (const auto& [name, way, coherent] : kEmbreeWays) {
        side.modes.emplace_back(prefix + name, *side.scenes.back(), way, coherent);
        side.rows.emplace_back(prefix + name, *side.scenes.back(), way, coherent);
      }
    }
  }
  return side;
}

// One build of kdray.
struct Build {
  core::BuildKind kind;
  core::Scene scene;
};
Build BuildOf(std::shared_ptr<const core::TriangleMesh> mesh, core::BuildKind kind) {
  auto tree = std::make_shared<const core::Tree>(core::BuildTree(*mesh, kind).value());
  return {kind, {std::move(mesh), std::move(tree)}};
}

// The build to measure and, beside it, the other one of those that auto chooses from.
std::vector<Build> BuildsFor(const std::shared_ptr<const core::TriangleMesh>& mesh,
                             const Options& options) {
  std::vector<Build> builds;
  if (options.build && *options.build != core::BuildKind::kKdSah &&
      *options.build != core::BuildKind::kBvh) {
    builds.push_back(BuildOf(mesh, *options.build));
    return builds;
  }
  builds.push_back(BuildOf(mesh, core::BuildKind::kBvh));
  builds.push_back(BuildOf(mesh, core::BuildKind::kKdSah));
  core::AutoChoice choice;
  choice.overlap = core::BoxOverlap(*mesh).value();
  const core::AutoChoice::Costs costs{core::ExpectedCost(*builds[0].scene.tree).value(),
                                      core::ExpectedCost(*builds[1].scene.tree).value()};
  if (!choice.OverlapsLittle()) choice.costs = costs;
  std::printf("auto: %s. Expected cost: bvh %.1f, kd-sah %.1f.\n\n",
              std::string(Name(choice.build())).c_str(), costs.bvh, costs.kd_sah);
  if (options.build.value_or(choice.build()) != builds[0].kind) std::swap(builds[0], builds[1]);
  return builds;
}

// The fastest modes of Embree from rows to rows, in turn with kdray.
void MeasureRows(const BenchRays& batch, const Options& options, EmbreeSide* embree,
                 std::vector<KdrayMode>* ours, TraceRow* row, TraceCsv* csv,
                 const std::string& mesh) {
  constexpr std::size_t kFastest = 3;
  const double millions = static_cast<double>(batch.rays.size()) * 1e-6;
  for (const std::size_t precision : {0, 1}) {
    const std::size_t first = precision == 0 ? 0 : embree->first_robust;
    const std::size_t last = precision == 0 ? embree->first_robust : embree->modes.size();
    std::vector<std::size_t> fastest(last - first);
    std::iota(fastest.begin(), fastest.end(), first);
    std::sort(fastest.begin(), fastest.end(), [&](std::size_t a, std::size_t b) {
      return row->embree[a].median > row->embree[b].median;
    });
    fastest.resize(std::min(fastest.size(), kFastest));
    std::vector<double> our_speed;
    std::vector<std::vector<double>> speeds(fastest.size());
    for (int run = 0; run < options.runs; ++run) {
      our_speed.push_back(millions / (*ours)[precision].Run(batch, options.threads));
      for (std::size_t m = 0; m < fastest.size(); ++m) {
        speeds[m].push_back(millions / embree->rows[fastest[m]].Run(batch, options.threads));
      }
    }
    const Spread our_spread = SpreadOf(std::move(our_speed));
    double best = 0;
    for (std::size_t m = 0; m < fastest.size(); ++m) {
      EmbreeRows& mode = embree->rows[fastest[m]];
      const Mismatches differ = Compare(mode, embree->modes[embree->judge], batch.rays.size());
      if (static_cast<double>(differ.hit_or_miss + differ.distance) > 100 * millions + 1) {
        std::fprintf(stderr, "%s, %s: the rows of Embree are wrong\n", mesh.c_str(),
                     mode.name().c_str());
        std::exit(1);
      }
      const Spread spread = SpreadOf(std::move(speeds[m]));
      best = std::max(best, spread.median);
      csv->Row(mesh, batch.name, options.threads, "rows embree " + mode.name(), spread, nullptr);
      mode.Release();
    }
    (precision == 0 ? row->rows_fast : row->rows_watertight) = our_spread.median / best;
    csv->Row(mesh, batch.name, options.threads, "rows " + (*ours)[precision].name(), our_spread,
             nullptr);
  }
}

TraceRow MeasureClass(const std::string& mesh, const BenchRays& batch, const Options& options,
                      EmbreeSide* embree, std::vector<KdrayMode>* ours, TraceCsv* csv) {
  const double millions = static_cast<double>(batch.rays.size()) * 1e-6;
  std::vector<std::vector<double>> embree_speed(embree->modes.size()), our_speed(ours->size());
  for (EmbreeMode& mode : embree->modes) mode.Prepare(batch);
  for (int run = 0; run < options.runs; ++run) {
    // The two sides in turn, so that a disturbance meets both.
    for (std::size_t m = 0; m < std::max(embree->modes.size(), ours->size()); ++m) {
      if (m < ours->size()) {
        our_speed[m].push_back(millions / (*ours)[m].Run(batch, options.threads));
      }
      if (m < embree->modes.size()) {
        embree_speed[m].push_back(millions / embree->modes[m].Run(options.threads));
      }
    }
  }
  TraceRow row;
  row.name = batch.name;
  for (auto& speeds : embree_speed) row.embree.push_back(SpreadOf(std::move(speeds)));
  for (auto& speeds : our_speed) row.ours.push_back(SpreadOf(std::move(speeds)));
  row.plain = row.Best(0, embree->first_robust);
  row.robust = row.Best(embree->first_robust, embree->modes.size());
  std::vector<Mismatches> mismatches;
  for (const KdrayMode& mode : *ours) {
    mismatches.push_back(Compare(mode, embree->modes[embree->judge], batch.rays.size()));
  }
  MeasureRows(batch, options, embree, ours, &row, csv, mesh);
  PrintRow(row, embree->modes[row.plain].name(), embree->modes[row.robust].name(), mismatches,
           millions);
  for (std::size_t m = 0; m < ours->size(); ++m) {
    csv->Row(mesh, batch.name, options.threads, (*ours)[m].name(), row.ours[m], &mismatches[m]);
    if (m >= TraceRow::kPrecisions) {
      std::fprintf(stderr, "  %-24s %-28s %.1f\n", batch.name.c_str(), (*ours)[m].name().c_str(),
                   row.ours[m].median);
    }
  }
  for (std::size_t m = 0; m < embree->modes.size(); ++m) {
    csv->Row(mesh, batch.name, options.threads, "embree " + embree->modes[m].name(), row.embree[m],
             nullptr);
    embree->modes[m].Release();
  }
  return row;
}

// A shaded picture with a sample a pixel, by core/render and with Embree's hits.
void MeasurePicture(const std::string& mesh, const BenchView& view, const Options& options,
                    const std::vector<Build>& builds, EmbreeSide* embree, TraceCsv* csv) {
  const int side = 2 * options.side;
  core::RenderSpec spec = PictureOf(view, side);
  const core::RenderedImage image = core::Render(builds[0].scene, spec).value();
  std::vector<std::string> names;
  std::vector<EmbreePicture> pictures;
  std::size_t first_robust = 0;
  for (std::size_t m = 0; m < embree->modes.size(); ++m) {
    const EmbreeWay& way = kEmbreeWays[m % std::size(kEmbreeWays)];
    if (m == embree->first_robust) first_robust = pictures.size();
    if (!way.coherent) continue;
    const EmbreeScene& scene = *embree->scenes[m / std::size(kEmbreeWays)];
    pictures.emplace_back(embree->modes[m].name(), scene, way.way, true, builds[0].scene, spec,
                          image);
  }
  struct Ours {
    std::string name;
    const core::Scene* scene;
    core::Precision precision;
  };
  std::vector<Ours> ours;
  for (const Build& build : builds) {
    for (const core::Precision precision : core::kAllPrecisions) {
      if (&build != &builds[0] && ours.size() >= TraceRow::kPrecisions + 2) continue;
      const std::string of = &build == &builds[0] ? "" : " " + std::string(Name(build.kind));
      ours.push_back({"kdray " + std::string(core::Name(precision)) + of, &build.scene, precision});
    }
  }
  const double millions = 1e-6 * side * side;
  std::vector<std::vector<double>> embree_speed(pictures.size()), our_speed(ours.size());
  for (int run = 0; run < options.runs; ++run) {
    for (std::size_t m = 0; m < std::max(pictures.size(), ours.size()); ++m) {
      if (m < ours.size()) {
        spec.precision = ours[m].precision;
        const Stopwatch watch(options.threads);
        if (!core::Render(*ours[m].scene, spec).ok()) std::exit(1);
        our_speed[m].push_back(millions / watch.seconds());
      }
      if (m < pictures.size()) {
        embree_speed[m].push_back(millions / pictures[m].Run(options.threads));
      }
    }
  }
  TraceRow row;
  row.name = "render";
  for (auto& speeds : embree_speed) row.embree.push_back(SpreadOf(std::move(speeds)));
  for (auto& speeds : our_speed) row.ours.push_back(SpreadOf(std::move(speeds)));
  row.plain = row.Best(0, first_robust);
  row.robust = row.Best(first_robust, pictures.size());
  for (const EmbreePicture& picture : pictures) {
    if (picture.Difference() > 1e-3) {
      std::fprintf(stderr, "%s, %s: the picture differs in %.2g of its pixels\n", mesh.c_str(),
                   picture.name().c_str(), picture.Difference());
    }
  }
  PrintRow(row, pictures[row.plain].name(), pictures[row.robust].name(), {}, millions);
  for (std::size_t m = 0; m < ours.size(); ++m) {
    csv->Row(mesh, row.name, options.threads, ours[m].name, row.ours[m], nullptr);
  }
  for (std::size_t m = 0; m < pictures.size(); ++m) {
    csv->Row(mesh, row.name, options.threads, "embree " + pictures[m].name(), row.embree[m],
             nullptr);
  }
}

void RunMesh(const std::string& name, const Options& options, TraceCsv* csv) {
  std::fprintf(stderr, "%s: loading\n", name.c_str());
  const BenchMesh bench = LoadBenchMesh(name);
  const auto mesh =
      std::make_shared<const core::TriangleMesh>(core::TriangleMesh::Create(bench.data).value());
  std::printf("\n### %s: %zu triangles, %d thread%s\n\n", name.c_str(), mesh->triangle_count(),
              options.threads, options.threads == 1 ? "" : "s");
  const std::vector<Build> builds = BuildsFor(mesh, options);
  const std::vector<BenchRays> classes = MakeRayClasses(*mesh, bench, options.side);

  std::fprintf(stderr, "%s: building for Embree\n", name.c_str());
  EmbreeSide embree = BuildEmbree(bench, options);
  std::vector<KdrayMode> ours;
  for (const Precision precision : core::kAllPrecisions) {
    ours.emplace_back("kdray " + std::string(core::Name(precision)), builds[0].scene,
                      core::TraceOptions{precision, {}});
  }
  if (builds.size() > 1) {
    for (const Precision precision : {Precision::kFast, Precision::kWatertight}) {
      ours.emplace_back(
          "kdray " + std::string(core::Name(precision)) + " " + std::string(Name(builds[1].kind)),
          builds[1].scene, core::TraceOptions{precision, {}});
    }
  }
  if (options.kernels) {
    for (const core::KernelKind kernel : core::kAllKernelKinds) {
      for (const bool sort : {false, true}) {
        core::TraceOptions forced{Precision::kFast, {}};
        forced.kernel = kernel;
        forced.sort = sort;
        ours.emplace_back("kdray fast " + std::string(core::Name(kernel)) + (sort ? " sorted" : ""),
                          builds[0].scene, forced);
      }
    }
  }

  const auto triangles = static_cast<double>(mesh->triangle_count());
  for (const Build& build : builds) {
    std::printf("%s: %.1f bytes a triangle (nodes and leaf blocks). ",
                std::string(Name(build.kind)).c_str(),
                static_cast<double>(build.scene.tree->bytes()) / triangles);
  }
  std::printf("Embree MEDIUM: %.1f.\n\n",
              static_cast<double>(embree.scenes.front()->bytes()) / triangles);
  std::vector<std::string> names;
  for (const Build& build : builds) names.emplace_back(Name(build.kind));
  PrintTableHead(names.size() > 1 ? names[1] : "");
  std::vector<TraceRow> rows;
  for (const BenchRays& batch : classes) {
    if (batch.name.find(options.rays) == std::string::npos) continue;
    rows.push_back(MeasureClass(name, batch, options, &embree, &ours, csv));
  }
  if (std::string("render").find(options.rays) != std::string::npos) {
    MeasurePicture(name, ViewOf(*mesh, bench), options, builds, &embree, csv);
  }
  if (!rows.empty()) PrintSummary(rows, names);
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
      options.build = core::ParseBuildKind(build);
      if (!options.build && build != "auto") {
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
  TraceCsv csv(options.csv);
  core::Arena arena(options.threads);
  for (const std::string& mesh : options.meshes) {
    arena.Run([&] { RunMesh(mesh, options, &csv); });
  }
  return 0;
}

}  // namespace
}  // namespace kdray::bench

int main(int argc, char** argv) { return kdray::bench::Main(argc, argv); }
