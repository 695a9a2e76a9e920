// SPDX-License-Identifier: Apache-2.0
// How long builds take: every kind beside Embree's two qualities, taken in turn in one process, on
// one thread and on two; and how builds and queries grow with the mesh, against the lecture note's
// claims (a build in n log^2 n or better, a query in log n).
//
// Options: --mesh NAME (may be repeated; default: all five), --runs N (default 7; builds without a
// target and large meshes run less), --threads N (may be repeated; default: 1 and 2), --csv FILE;
// --scaling [--most TRIANGLES] [--runs N] for the growth instead.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <memory>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "core/base/parallel.h"
#include "core/scene/scene.h"
#include "core/trace/trace.h"
#include "tests/bench/scenes.h"

namespace kdray::bench {
namespace {

using core::BuildKind;
using core::TriangleMesh;

struct Options {
  std::vector<std::string> meshes;
  int runs = 7;
  std::vector<int> threads;
  std::string csv;
  bool scaling = false;
  std::size_t most = 4'000'000;
};

double SecondsOf(const auto& work) {
  const auto start = std::chrono::steady_clock::now();
  work();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

core::Tree Build(const TriangleMesh& mesh, BuildKind kind, core::Arena& arena) {
  core::Result<core::Tree> tree = core::Error{core::ErrorCode::kInternal, "not built"};
  arena.Run([&] { tree = core::BuildTree(mesh, kind); });
  if (!tree.ok()) {
    std::fprintf(stderr, "%s\n", tree.error().message.c_str());
    std::exit(1);
  }
  return *std::move(tree);
}

// One row of the table: a builder and its times, for each number of threads.
struct Row {
  std::string name;
  std::vector<std::vector<double>> seconds;
  std::string remark;
};

std::string Text(const char* format, auto... values) {
  char text[200];
  std::snprintf(text, sizeof text, format, values...);
  return text;
}

// How often a builder runs: those that have a target as often as asked, the others less, since the
// slowest take ten times as long; large meshes less, since one run already takes many seconds.
int RunsOf(const std::string& builder, std::size_t triangles, int asked) {
  constexpr std::size_t kLarge = 2'000'000;
  const bool has_target =
      builder.starts_with("Embree") || builder == "kd-sah" || builder == "kd-binned";
  const int most = triangles > kLarge ? (has_target ? 3 : 1) : (has_target ? asked : 3);
  return std::min(most, asked);
}

void Compare(const std::string& mesh_name, const Options& options, std::ostream* csv) {
  const BenchMesh bench = LoadBenchMesh(mesh_name);
  const TriangleMesh mesh = TriangleMesh::Create(bench.data).value();

  std::vector<Row> rows = {{"Embree MEDIUM", {}, ""}, {"Embree HIGH", {}, ""}};
  for (const BuildKind kind : core::kAllBuildKinds)
    rows.push_back({std::string(Name(kind)), {}, ""});
  for (const int threads : options.threads) {
    core::Arena arena(threads);
    for (Row& row : rows) row.seconds.emplace_back();
    // The first round warms up caches and allocators, for those that run more than once.
    for (int run = -1; run < options.runs; ++run) {
      for (std::size_t i = 0; i < rows.size(); ++i) {
        const int runs = RunsOf(rows[i].name, mesh.triangle_count(), options.runs);
        if (run < 0 ? runs == 1 : run >= runs) continue;
        double seconds = 0;
        if (i < 2) {
          const auto quality = i == 0 ? RTC_BUILD_QUALITY_MEDIUM : RTC_BUILD_QUALITY_HIGH;
          const EmbreeScene scene(bench.data, quality, false, threads);
          seconds = scene.build_seconds();
          rows[i].remark = Text("%.0f B/tri", static_cast<double>(scene.bytes()) /
                                                  static_cast<double>(mesh.triangle_count()));
        } else {
          core::Tree tree;
          seconds = SecondsOf([&] { tree = Build(mesh, core::kAllBuildKinds[i - 2], arena); });
          const double n = static_cast<double>(mesh.triangle_count());
          rows[i].remark = Text(
              "%.0f B/tri, %.2f references/tri, SAH %.1f", static_cast<double>(tree.bytes()) / n,
              static_cast<double>(tree.stats.references) / n, tree.stats.sah_cost);
        }
        if (run < 0) continue;
        rows[i].seconds.back().push_back(seconds);
        if (csv != nullptr) {
          *csv << bench.name << ',' << mesh.triangle_count() << ',' << rows[i].name << ','
               << threads << ',' << run << ',' << seconds << '\n';
        }
      }
    }
  }

  std::printf("\n#### %s, %zu triangles: milliseconds, median (least to most)\n\n",
              bench.name.c_str(), mesh.triangle_count());
  std::printf("| build | runs |");
  for (const int threads : options.threads)
    std::printf(" %d thread%s |", threads, threads == 1 ? "" : "s");
  std::printf(" to MEDIUM | to HIGH | speed-up | tree |\n|---|");
  for (std::size_t i = 0; i < options.threads.size() + 5; ++i) std::printf("---|");
  std::printf("\n");
  const auto median = [&](std::size_t row, std::size_t t) {
    return SpreadOf(rows[row].seconds[t]).median;
  };
  for (std::size_t i = 0; i < rows.size(); ++i) {
    std::printf("| %s | %zu |", rows[i].name.c_str(), rows[i].seconds.front().size());
    for (const std::vector<double>& seconds : rows[i].seconds) {
      const Spread s = SpreadOf(seconds);
      std::printf(" %.1f (%.1f to %.1f) |", s.median * 1e3, s.low * 1e3, s.high * 1e3);
    }
    std::printf(" %.2f | %.2f |", median(i, 0) / median(0, 0), median(i, 0) / median(1, 0));
    std::printf(" %.2f | %s |\n", median(i, 0) / median(i, options.threads.size() - 1),
                rows[i].remark.c_str());
  }
  std::fflush(stdout);
}

// --- Growth

struct Point {
  double triangles = 0;
  double build_seconds = 0;
  double ray_seconds = 0;
  double nodes = 0;  // visited by a ray
};

// y = a + b x by least squares, and how much of the spread of y it explains.
struct Line {
  double a = 0, b = 0, r2 = 0;
};
Line Fit(const std::vector<Point>& points, const auto& x_of, const auto& y_of) {
  double n = 0, sx = 0, sy = 0, sxx = 0, sxy = 0, syy = 0;
  for (const Point& p : points) {
    const double x = x_of(p), y = y_of(p);
    n += 1;
    sx += x;
    sy += y;
    sxx += x * x;
    sxy += x * y;
    syy += y * y;
  }
  const double xx = sxx - sx * sx / n, xy = sxy - sx * sy / n, yy = syy - sy * sy / n;
  const double b = xy / xx;
  return {(sy - b * sx) / n, b, yy > 0 ? xy * xy / (xx * yy) : 1};
}

// Rays through two random points of the bounds.
std::vector<core::RayF> RandomRays(const core::Bounds3d& bounds, std::size_t count) {
  std::mt19937_64 engine(1975);
  const auto point = [&] {
    core::Vec3f p;
    for (int axis = 0; axis < 3; ++axis) {
      p[axis] = static_cast<float>(
          std::uniform_real_distribution<>(bounds.min[axis], bounds.max[axis])(engine));
    }
    return p;
  };
  std::vector<core::RayF> rays;
  for (std::size_t i = 0; i < count; ++i) {
    const core::Vec3f from = point();
    rays.push_back({from, 0, point() - from, std::numeric_limits<float>::infinity()});
  }
  return rays;
}

// Median of `runs` times, after one that warms up; of a single run nothing comes before.
double MedianSeconds(int runs, const auto& work) {
  if (runs > 1) work();
  std::vector<double> seconds;
  for (int run = 0; run < runs; ++run) seconds.push_back(SecondsOf(work));
  return SpreadOf(seconds).median;
}

Point Measure(const std::shared_ptr<const TriangleMesh>& mesh, BuildKind kind, int runs) {
  // A box tests every triangle, so with as many rays as the others it would take all day.
  constexpr std::size_t kRays = 50'000;
  constexpr std::size_t kLeastRays = 8;
  constexpr std::size_t kBoxTests = 25'000'000;
  const std::size_t triangles = mesh->triangle_count();
  const std::size_t rays =
      kind == BuildKind::kBox ? std::clamp(kBoxTests / triangles, kLeastRays, kRays) : kRays;

  core::Arena arena(1);
  Point point;
  point.triangles = static_cast<double>(triangles);
  std::shared_ptr<const core::Tree> tree;
  point.build_seconds =
      MedianSeconds(runs, [&] { tree = std::make_shared<core::Tree>(Build(*mesh, kind, arena)); });

  const std::vector<core::RayF> batch = RandomRays(mesh->bounds(), rays);
  const core::Scene scene{mesh, tree};
  const core::TraceOptions options{core::Precision::kWatertight, {}};
  std::vector<core::Hit> hits(rays);
  std::vector<core::TraceCost> costs(rays);
  arena.Run([&] {
    const std::span<const core::RayF> all(batch);
    point.ray_seconds =
        MedianSeconds(runs, [&] { (void)core::TraceClosest(scene, all, options, hits); }) /
        static_cast<double>(rays);
    (void)core::TraceCostly(scene, all, options, hits, costs);
  });
  for (const core::TraceCost& cost : costs) point.nodes += cost.nodes_visited;
  point.nodes /= static_cast<double>(rays);
  return point;
}

void MeasureGrowth(const Options& options, std::ostream* csv) {
  // Two sizes a factor of ten, both ends included.
  constexpr double kLeast = 1000;
  const double factor = std::max(1.0, static_cast<double>(options.most) / kLeast);
  const int steps = std::max(1, static_cast<int>(std::lround(2 * std::log10(factor))));
  std::vector<std::vector<Point>> points(core::kAllBuildKinds.size());
  for (int step = 0; step <= steps; ++step) {
    const double wanted = kLeast * std::pow(factor, static_cast<double>(step) / steps);
    const int frequency = static_cast<int>(std::lround(std::sqrt(wanted / 20)));
    const auto mesh =
        std::make_shared<const TriangleMesh>(TriangleMesh::Create(FoldedSphere(frequency)).value());
    const int runs = mesh->triangle_count() > 500'000 ? 1 : options.runs;
    for (std::size_t k = 0; k < points.size(); ++k) {
      const BuildKind kind = core::kAllBuildKinds[k];
      points[k].push_back(Measure(mesh, kind, runs));
      const Point& p = points[k].back();
      if (csv != nullptr) {
        *csv << Name(kind) << ',' << mesh->triangle_count() << ',' << p.build_seconds << ','
             << p.ray_seconds << ',' << p.nodes << '\n';
      }
    }
    std::fprintf(stderr, "%zu triangles done\n", mesh->triangle_count());
  }

  const auto log_n = [](const Point& p) { return std::log2(p.triangles); };
  std::printf("\n#### Growth, one thread, folded spheres of %.0f to %.0f triangles\n\n",
              points[0].front().triangles, points[0].back().triangles);
  std::printf(
      "| build | time ~ n^p: p | ns per n log2 n: first, last | ray ~ n^p: p | ray = a + b log2 n: "
      "a, b (ns) | of its "
      "spread | nodes = a + b log2 n: a, b | of its spread |\n|---|---|---|---|---|---|---|---|\n");
  for (std::size_t k = 0; k < points.size(); ++k) {
    const std::vector<Point>& of = points[k];
    const Line build = Fit(of, log_n, [](const Point& p) { return std::log2(p.build_seconds); });
    const Line ray = Fit(of, log_n, [](const Point& p) { return std::log2(p.ray_seconds); });
    const Line ray_log = Fit(of, log_n, [](const Point& p) { return p.ray_seconds * 1e9; });
    const Line nodes = Fit(of, log_n, [](const Point& p) { return p.nodes; });
    const auto per = [&](const Point& p) {
      return p.build_seconds * 1e9 / (p.triangles * std::log2(p.triangles));
    };
    const std::string name(Name(core::kAllBuildKinds[k]));
    std::printf("| %s | %.2f | %.2f, %.2f | %.2f | %.0f, %.0f | %.2f | %.1f, %.2f | %.2f |\n",
                name.c_str(), build.b, per(of.front()), per(of.back()), ray.b, ray_log.a, ray_log.b,
                ray_log.r2, nodes.a, nodes.b, nodes.r2);
  }
}

Options ParseOptions(int count, char** arguments) {
  Options options;
  for (int i = 1; i < count; ++i) {
    const std::string name = arguments[i];
    const auto value = [&] {
      if (i + 1 < count) return std::string(arguments[++i]);
      std::fprintf(stderr, "%s needs a value\n", name.c_str());
      std::exit(2);
    };
    if (name == "--mesh") {
      options.meshes.push_back(value());
    } else if (name == "--runs") {
      options.runs = std::max(1, std::atoi(value().c_str()));
    } else if (name == "--threads") {
      options.threads.push_back(std::max(1, std::atoi(value().c_str())));
    } else if (name == "--csv") {
      options.csv = value();
    } else if (name == "--scaling") {
      options.scaling = true;
    } else if (name == "--most") {
      options.most = static_cast<std::size_t>(std::atoll(value().c_str()));
    } else {
      std::fprintf(stderr, "no option is called %s\n", name.c_str());
      std::exit(2);
    }
  }
  if (options.meshes.empty()) {
    options.meshes = {"bunny_69k", "classroom_111k", "igea_268k", "scan_1m", "scan_4m"};
  }
  if (options.threads.empty()) options.threads = {1, 2};
  return options;
}

}  // namespace
}  // namespace kdray::bench

int main(int count, char** arguments) {
  using namespace kdray::bench;
  const Options options = ParseOptions(count, arguments);
  std::ofstream file;
  if (!options.csv.empty()) {
    file.open(options.csv);
    file << (options.scaling ? "build,triangles,build_seconds,ray_seconds,nodes_per_ray\n"
                             : "mesh,triangles,builder,threads,run,seconds\n");
  }
  std::ostream* csv = file.is_open() ? &file : nullptr;
  std::printf("%s\n", MachineLine().c_str());
  if (options.scaling) {
    MeasureGrowth(options, csv);
  } else {
    for (const std::string& mesh : options.meshes) Compare(mesh, options, csv);
  }
  return 0;
}
