// SPDX-License-Identifier: Apache-2.0
// The work of HTTP requests in process: the rays of a batch through the kernels, and a picture.
// Writes the batch as rays.npy into a folder, and the times as CSV to standard output.
// tests/bench/http runs it, then asks the daemon for the same.
//   bench_http FOLDER RUNS
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "core/base/parallel.h"
#include "core/io/png_writer.h"
#include "core/render/picture.h"
#include "core/render/renderer.h"
#include "core/trace/trace.h"
#include "tests/bench/scenes.h"
#include "tests/support/npy_array.h"

namespace kdray::bench {
namespace {

constexpr std::size_t kRays = 1'000'000;
constexpr int kSide = 1024;  // pixels of the picture, and of the picture whose rays are sent

core::Scene MakeScene(const core::MeshData& data) {
  auto mesh = core::TriangleMesh::Create(data);
  if (!mesh.ok()) std::exit(1);
  core::Scene scene;
  scene.mesh = std::make_shared<const core::TriangleMesh>(*std::move(mesh));
  auto tree = core::BuildTree(*scene.mesh, core::BuildKind::kKdSah);
  if (!tree.ok()) std::exit(1);
  scene.tree = std::make_shared<const core::Tree>(*std::move(tree));
  return scene;
}

template <class F>
void Measure(const std::string& what, int threads, int runs, const F& f) {
  core::Arena arena(threads);
  std::vector<double> ms;
  for (int run = 0; run < runs; ++run) {
    const auto start = std::chrono::steady_clock::now();
    arena.Run(f);
    ms.push_back(std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start)
                     .count());
  }
  std::printf("%s,%d,%.4f\n", what.c_str(), threads, SpreadOf(ms).median);
}

void MeasureBatch(const core::Scene& scene, core::RayBatch rays, const std::string& form,
                  int threads, int runs) {
  core::TraceOptions options;
  options.precision = core::AutoPrecision(*scene.mesh);
  std::vector<core::Hit> hits(rays.size());
  std::vector<std::uint8_t> occluded(rays.size());
  Measure(form + " closest", threads, runs,
          [&] { static_cast<void>(core::TraceClosest(scene, rays, options, hits)); });
  Measure(form + " any", threads, runs,
          [&] { static_cast<void>(core::TraceAny(scene, rays, options, occluded)); });
}

int Main(const std::string& folder, int runs) {
  const BenchMesh mesh = LoadBenchMesh("igea_268k");
  const core::Scene scene = MakeScene(mesh.data);
  std::vector<core::RayF> rays = MakeRayClasses(*scene.mesh, mesh, kSide / 2).front().rays;
  rays.resize(kRays);
  std::vector<core::Ray> wide;
  std::vector<float> numbers;
  for (const core::RayF& ray : rays) {
    wide.push_back({core::Vec3d(ray.origin), 0, core::Vec3d(ray.direction)});
    numbers.insert(numbers.end(), {ray.origin.x, ray.origin.y, ray.origin.z, ray.direction.x,
                                   ray.direction.y, ray.direction.z});
  }
  std::ofstream(folder + "/rays.npy", std::ios::binary) << test::NpyArray(numbers, 6);

  const int all = static_cast<int>(std::thread::hardware_concurrency());
  std::printf("what,threads,ms\n");
  for (const int threads : {1, all}) {
    MeasureBatch(scene, std::span<const core::RayF>(rays), "npy", threads, runs);
    MeasureBatch(scene, std::span<const core::Ray>(wide), "json", threads, runs);
    core::RenderSpec spec;
    spec.width = spec.height = kSide;
    spec.samples = 1;
    spec.precision = core::AutoPrecision(*scene.mesh);
    Measure("picture", threads, runs, [&] { static_cast<void>(core::Render(scene, spec)); });
    if (threads == all) break;
  }
  return 0;
}

}  // namespace
}  // namespace kdray::bench

int main(int argc, char** argv) {
  if (argc != 3) return 2;
  return kdray::bench::Main(argv[1], std::atoi(argv[2]));
}
