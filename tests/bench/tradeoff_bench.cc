// SPDX-License-Identifier: Apache-2.0
// Measures every build with every precision (core/tradeoff) on each mesh of the collection and
// writes a table with a row for each, as CSV, to standard output. tests/bench/tradeoff runs it.
#include <charconv>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <iostream>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "core/base/parallel.h"
#include "core/library/parse_mesh.h"
#include "core/tradeoff/tradeoff.h"
#include "tests/support/mesh_files.h"

namespace kdray::bench {
namespace {

struct Options {
  double minutes = 5;  ///< for tracing, over all meshes
  std::uint64_t max_triangles = 300'000;
  int threads = static_cast<int>(std::thread::hardware_concurrency());
  core::TradeoffOptions measure;
};

double NumberOf(std::string_view text) {
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || !(value > 0)) {
    std::cerr << "bench_tradeoff: '" << text << "' is no number above 0\n";
    std::exit(2);
  }
  return value;
}

Options ParseOptions(int argc, char** argv) {
  Options options;
  options.measure.runs = 5;
  options.measure.rays = std::size_t{1} << 17;
  for (int i = 1; i + 1 < argc; i += 2) {
    const std::string_view name = argv[i];
    const double value = NumberOf(argv[i + 1]);
    if (name == "--minutes") {
      options.minutes = value;
    } else if (name == "--max-triangles") {
      options.max_triangles = static_cast<std::uint64_t>(value);
    } else if (name == "--threads") {
      options.threads = static_cast<int>(value);
    } else if (name == "--rays") {
      options.measure.rays = static_cast<std::size_t>(value);
    } else if (name == "--runs") {
      options.measure.runs = static_cast<int>(value);
    } else if (name == "--seed") {
      options.measure.seed = static_cast<std::uint64_t>(value);
    } else {
      std::cerr << "bench_tradeoff: there is no option " << name
                << "; there are --minutes, --max-triangles, --threads, --rays, --runs, --seed\n";
      std::exit(2);
    }
  }
  return options;
}

struct BenchMesh {
  std::string name;
  bool closed;
  std::shared_ptr<const core::TriangleMesh> mesh;
};

std::vector<BenchMesh> LoadCollection(const Options& options) {
  const auto folder = test::MeshFolder();
  if (!folder) {
    std::cerr << "bench_tradeoff: no mesh collection: set KDRAY_MESHES\n";
    std::exit(1);
  }
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::directory_iterator(*folder)) {
    if (entry.is_regular_file()) files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  std::vector<BenchMesh> meshes;
  for (const auto& file : files) {
    core::Result<core::ParsedMesh> parsed =
        core::ParseMesh(test::ReadFileBytes(file), core::CancelToken());
    // Lists, notes, formats that are not read yet.
    if (!parsed.ok() || parsed->facts.triangles > options.max_triangles) continue;
    const bool closed = parsed->facts.health.closed;
    meshes.push_back({file.filename().string(), closed,
                      std::make_shared<const core::TriangleMesh>(std::move(parsed->mesh))});
  }
  return meshes;
}

void PrintSpeed(const core::Speed& speed) {
  std::printf(",%.6g,%.6g,%.6g", speed.rays_per_s, speed.slowest, speed.fastest);
}

void Print(const std::string& mesh, const core::Tradeoff& measured) {
  const std::size_t precisions = measured.precisions.size();
  for (std::size_t i = 0; i < measured.pairs.size(); ++i) {
    const core::MeasuredPair& pair = measured.pairs[i];
    const core::MeasuredBuild& build = measured.builds[i / precisions];
    const core::Accuracy& accuracy = measured.precisions[i % precisions];
    std::printf("%s,%llu,%d,%s,%s,%.6g,%llu,%.9g", mesh.c_str(),
                static_cast<unsigned long long>(measured.triangles), measured.closed ? 1 : 0,
                std::string(core::Name(pair.build)).c_str(),
                std::string(core::Name(pair.precision)).c_str(), build.build_ms,
                static_cast<unsigned long long>(build.bytes), build.sah_cost);
    PrintSpeed(pair.random);
    PrintSpeed(pair.aimed);
    std::printf(",%.6g,%.6g,%.6g,%.6g", build.random.nodes, build.random.triangles,
                build.aimed.nodes, build.aimed.triangles);
    if (accuracy.leaks) {
      std::printf(",%llu", static_cast<unsigned long long>(accuracy.leaks->count));
    } else {
      std::printf(",");
    }
    for (const std::uint64_t count :
         {accuracy.wrong_triangles.count, accuracy.unconnected_triangles.count,
          accuracy.folds.count, accuracy.missed_hits.count, accuracy.extra_hits.count,
          accuracy.missed_hits.rays, accuracy.t_error.rays}) {
      std::printf(",%llu", static_cast<unsigned long long>(count));
    }
    std::printf(",%.6g,%.6g,%llu\n", accuracy.t_error.p999, accuracy.t_error.max,
                static_cast<unsigned long long>(pair.differences.count));
  }
  std::fflush(stdout);
}

int Run(int argc, char** argv) {
  Options options = ParseOptions(argc, argv);
  const std::vector<BenchMesh> meshes = LoadCollection(options);
  options.measure.threads = options.threads;
  options.measure.trace_time = std::chrono::milliseconds(
      static_cast<std::int64_t>(options.minutes * 60000 / static_cast<double>(meshes.size())));
  std::printf(
      "mesh,triangles,closed,build,precision,build_ms,bytes,sah_cost,random_rays_per_s,"
      "random_slowest,random_fastest,aimed_rays_per_s,aimed_slowest,aimed_fastest,random_nodes,"
      "random_triangles,aimed_nodes,aimed_triangles,leaks,wrong,unconnected,folds,missed,extra,"
      "rays,"
      "t_rays,t_p999,t_max,differences\n");
  core::Arena arena(options.threads);
  bool failed = false;
  for (std::size_t i = 0; i < meshes.size(); ++i) {
    const BenchMesh& mesh = meshes[i];
    std::cerr << "bench_tradeoff: " << i + 1 << " of " << meshes.size() << ": " << mesh.name << ", "
              << mesh.mesh->triangle_count() << " triangles\n";
    arena.Run([&] {
      const auto measured =
          core::MeasureTradeoff(mesh.mesh, mesh.closed, options.measure, core::CancelToken());
      if (measured.ok()) {
        Print(mesh.name, *measured);
      } else {
        std::cerr << "bench_tradeoff: " << measured.error().message << "\n";
        failed = true;
      }
    });
  }
  return failed ? 1 : 0;
}

}  // namespace
}  // namespace kdray::bench

int main(int argc, char** argv) { return kdray::bench::Run(argc, argv); }
