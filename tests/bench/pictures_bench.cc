// SPDX-License-Identifier: Apache-2.0
// Time of whole pictures beside the time in which the kernels trace the same rays: one thread,
// 1024 x 768, shaded. Writes CSV to standard output.
//
// Arguments: names of meshes (default: bunny_69k, igea_268k, classroom_111k).
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <iostream>
#include <span>
#include <string>
#include <vector>

#include "core/base/parallel.h"
#include "core/render/camera_rays.h"
#include "core/render/picture.h"
#include "core/render/pixel_filter.h"
#include "core/render/pixel_order.h"
#include "core/render/renderer.h"
#include "core/render/sampler.h"
#include "core/trace/trace.h"
#include "tests/bench/scenes.h"
#include "tests/support/scenes.h"

namespace kdray::bench {
namespace {

constexpr int kWidth = 1024, kHeight = 768;
constexpr int kRuns = 5;

// The time that this thread had the processor.
double Now() {
  timespec t;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

// Calls f with the rays of each tile of the picture, in the order and the precision of the
// renderer.
template <class F>
void ForEachTile(const core::Scene& scene, const core::Camera& camera, int samples, const F& f) {
  const core::CameraRays rays(camera);
  const bool in_float = samples > 1 && rays.FitFloat(scene.mesh->bounds());
  const core::PixelFilter& filter = core::PixelFilter::Get();
  const int side = std::max(8, static_cast<int>(std::sqrt(4096.0 / samples)) / 8 * 8);
  const core::TileGrid tiles({0, 0, kWidth, kHeight}, side);
  std::vector<core::Ray> doubles;
  std::vector<core::RayF> floats;
  for (std::size_t i = 0; i < tiles.size(); ++i) {
    doubles.clear();
    floats.clear();
    const core::Tile tile = tiles[i];
    for (const std::uint32_t pixel : core::PixelOrder(tile.width(), tile.height())) {
      const int x = tile.x0 + static_cast<int>(pixel) % tile.width();
      const int y = tile.y0 + static_cast<int>(pixel) / tile.width();
      const core::PixelSampler sampler(0, x, y);
      const core::CameraRays::Around around(rays, x + 0.5, y + 0.5);
      const core::CameraRays::AroundInFloat around_in_float(rays, x + 0.5, y + 0.5);
      for (std::uint32_t n = 0; n < static_cast<std::uint32_t>(samples); ++n) {
        const float dx = filter.Offset(sampler[n].x), dy = filter.Offset(sampler[n].y);
        if (in_float) {
          around_in_float.Write(dx, dy, &floats.emplace_back());
        } else if (samples == 1) {
          doubles.push_back(camera.RayThrough(x + 0.5, y + 0.5));
        } else {
          doubles.push_back(around.At(static_cast<double>(dx), static_cast<double>(dy)));
        }
      }
    }
    if (in_float) {
      f(core::RayBatch(std::span<const core::RayF>(floats)));
    } else {
      f(core::RayBatch(std::span<const core::Ray>(doubles)));
    }
  }
}

double SecondsOfKernels(const core::Scene& scene, const core::Camera& camera, int samples) {
  double seconds = 0;
  std::vector<core::Hit> hits;
  ForEachTile(scene, camera, samples, [&](const core::RayBatch& rays) {
    hits.resize(rays.size());
    const double start = Now();
    if (!core::TraceClosest(scene, rays, {}, hits).ok()) std::exit(1);
    seconds += Now() - start;
  });
  return seconds;
}

void Run(const std::string& name) {
  const BenchMesh mesh = LoadBenchMesh(name);
  const core::Scene scene = test::MakeScene(mesh.data);
  for (const int samples : {1, 16}) {
    core::RenderSpec spec = {.width = kWidth, .height = kHeight, .samples = samples};
    std::vector<double> picture, kernels, encoding;
    for (int run = 0; run < kRuns; ++run) {
      const double start = Now();
      const core::Result<core::RenderedImage> image = core::Render(scene, spec);
      picture.push_back(Now() - start);
      if (!image.ok()) std::exit(1);
      const double rendered = Now();
      const core::Picture pixels = core::MakePicture(*image);
      encoding.push_back(Now() - rendered);
      kernels.push_back(SecondsOfKernels(scene, image->camera, samples));
    }
    const double rays = static_cast<double>(kWidth) * kHeight * samples * 1e-6;
    const double ours = SpreadOf(picture).median, theirs = SpreadOf(kernels).median;
    std::printf("%s,%d,%.4f,%.4f,%.2f,%.2f,%.2f,%.4f\n", name.c_str(), samples, ours, theirs,
                rays / ours, rays / theirs, ours / theirs, SpreadOf(encoding).median);
    std::fflush(stdout);
  }
}

}  // namespace
}  // namespace kdray::bench

int main(int argc, char** argv) {
  std::printf(
      "mesh,samples,picture_s,kernels_s,picture_mrays_s,kernels_mrays_s,ratio,encoding_s\n");
  std::vector<std::string> names(argv + 1, argv + argc);
  if (names.empty()) names = {"bunny_69k", "igea_268k", "classroom_111k"};
  kdray::core::Arena(1).Run([&] {
    for (const std::string& name : names) kdray::bench::Run(name);
  });
}
