// SPDX-License-Identifier: Apache-2.0
// What `auto` chooses, and what that costs: kd-sah and bvh over every mesh of the collection and
// the generated ones, with their expected costs and the speed of six classes of rays, one thread.
// Writes CSV to standard output.
//
// Options: --mesh NAME (may be repeated; a file of the collection, or a mesh of scenes.h),
// --max-triangles N (1200000), --side PIXELS (128), --runs N (5).
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "core/accel/auto_choice.h"
#include "core/accel/expected_cost.h"
#include "core/base/parallel.h"
#include "core/intersect/precision.h"
#include "core/io/mesh_reader.h"
#include "core/scene/scene.h"
#include "core/trace/trace.h"
#include "tests/bench/embree_modes.h"
#include "tests/bench/scenes.h"
#include "tests/support/mesh_files.h"

namespace kdray::bench {
namespace {

using core::BuildKind;

struct Options {
  std::vector<std::string> meshes;
  std::size_t max_triangles = 1'200'000;
  int side = 128;
  int runs = 5;
};

// A build, with what it takes.
struct Candidate {
  Candidate(std::shared_ptr<const core::TriangleMesh> mesh, BuildKind build) {
    const Stopwatch watch(1);
    auto tree = std::make_shared<const core::Tree>(core::BuildTree(*mesh, build).value());
    build_ms = 1e3 * watch.seconds();
    cost = core::ExpectedCost(*tree).value();
    scene = {std::move(mesh), std::move(tree)};
  }

  double Seconds(const BenchRays& batch, core::Precision precision) {
    const std::span<const core::RayF> rays(batch.rays);
    hits.resize(rays.size());
    occluded.resize(rays.size());
    const Stopwatch watch(1);
    const core::Status status = batch.any ? core::TraceAny(scene, rays, {precision, {}}, occluded)
                                          : core::TraceClosest(scene, rays, {precision, {}}, hits);
    if (!status.ok()) std::exit(1);
    return watch.seconds();
  }

  core::Scene scene;
  double build_ms = 0;
  double cost = 0;
  std::vector<core::Hit> hits;
  std::vector<std::uint8_t> occluded;
};

void Run(const BenchMesh& bench, const Options& options) {
  auto created = core::TriangleMesh::Create(bench.data);
  if (!created.ok() || core::NeedsNoTree(created->triangle_count())) return;
  const auto mesh = std::make_shared<const core::TriangleMesh>(*std::move(created));
  std::fprintf(stderr, "%s: %zu triangles\n", bench.name.c_str(), mesh->triangle_count());
  core::AutoChoice choice;
  const Stopwatch watch(1);
  choice.overlap = core::BoxOverlap(*mesh).value();
  const double overlap_ms = 1e3 * watch.seconds();
  Candidate kd(mesh, BuildKind::kKdSah), bvh(mesh, BuildKind::kBvh);
  if (!choice.OverlapsLittle()) choice.costs = {bvh.cost, kd.cost};

  const core::Precision precision =
      core::AutoPrecision(mesh->has_double_vertices(), mesh->shortest_edge());
  // Speeds as the geometric mean over the classes, of the fastest runs.
  double kd_log = 0, bvh_log = 0, ratio_log = 0;
  int classes = 0;
  for (const BenchRays& batch : MakeRayClasses(*mesh, bench, options.side)) {
    if (batch.rays.empty()) continue;
    double kd_best = 1e9, bvh_best = 1e9;
    for (int run = 0; run < options.runs; ++run) {
      kd_best = std::min(kd_best, kd.Seconds(batch, precision));
      bvh_best = std::min(bvh_best, bvh.Seconds(batch, precision));
    }
    const double millions = 1e-6 * static_cast<double>(batch.rays.size());
    kd_log += std::log(millions / kd_best);
    bvh_log += std::log(millions / bvh_best);
    ratio_log += std::log(kd_best / bvh_best);
    ++classes;
  }
  if (classes == 0) return;
  std::printf("%s,%zu,%s,%.4g,%.4g,%d,%s,%.4g,%.4g,%.4g,%.4g,%.5g,%.5g,%.4g,%.4g,%.4g\n",
              bench.name.c_str(), mesh->triangle_count(),
              std::string(core::Name(precision)).c_str(), choice.overlap, overlap_ms,
              choice.costs ? 1 : 0, std::string(core::Name(choice.build())).c_str(), kd.build_ms,
              bvh.build_ms, kd.scene.tree->stats.sah_cost, bvh.scene.tree->stats.sah_cost, kd.cost,
              bvh.cost, std::exp(kd_log / classes), std::exp(bvh_log / classes),
              std::exp(ratio_log / classes));
  std::fflush(stdout);
}

bool IsOfScenes(const std::string& name) {
  return name == "office" || name == "scan_1m" || name == "scan_4m" ||
         name.starts_with("classroom_inside");
}

int Main(int argc, char** argv) {
  Options options;
  for (int i = 1; i + 1 < argc; i += 2) {
    const std::string name = argv[i], value = argv[i + 1];
    if (name == "--mesh") {
      options.meshes.push_back(value);
    } else if (name == "--max-triangles") {
      options.max_triangles = std::strtoull(value.c_str(), nullptr, 10);
    } else if (name == "--side") {
      options.side = std::max(8, std::atoi(value.c_str()) / 8 * 8);
    } else if (name == "--runs") {
      options.runs = std::max(1, std::atoi(value.c_str()));
    } else {
      std::fprintf(stderr, "no such option: %s\n", name.c_str());
      return 2;
    }
  }
  const auto folder = test::MeshFolder();
  if (!folder) {
    std::fprintf(stderr, "no mesh collection: set KDRAY_MESHES\n");
    return 2;
  }
  if (options.meshes.empty()) {
    for (const auto& entry : std::filesystem::directory_iterator(*folder)) {
      if (entry.is_regular_file()) options.meshes.push_back(entry.path().filename().string());
    }
    std::sort(options.meshes.begin(), options.meshes.end());
    for (const char* name : {"classroom_inside", "office", "scan_1m"}) {
      options.meshes.push_back(name);
    }
  }
  std::printf(
      "mesh,triangles,precision,overlap,overlap_ms,compared,pick,kd_build_ms,bvh_build_ms,"
      "kd_sah_cost,bvh_sah_cost,kd_cost,bvh_cost,kd_mrays_s,bvh_mrays_s,bvh_to_kd\n");
  core::Arena arena(1);
  for (const std::string& name : options.meshes) {
    BenchMesh bench;
    if (IsOfScenes(name)) {
      bench = LoadBenchMesh(name);
    } else {
      // Also lists, notes, and meshes that are no meshes.
      auto data = core::ReadMesh(test::ReadFileBytes(*folder / name));
      if (!data.ok()) continue;
      bench = {name, *std::move(data), {}};
    }
    if (bench.data.triangles.size() > options.max_triangles) continue;
    arena.Run([&] { Run(bench, options); });
  }
  return 0;
}

}  // namespace
}  // namespace kdray::bench

int main(int argc, char** argv) { return kdray::bench::Main(argc, argv); }
