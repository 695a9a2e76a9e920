// SPDX-License-Identifier: Apache-2.0
// Error of pictures over time, for each precision: against a reference of many samples in `exact`.
// Writes CSV to standard output. tests/bench/images runs it.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <string>
#include <thread>
#include <vector>

#include "core/base/parallel.h"
#include "core/library/parse_mesh.h"
#include "core/render/renderer.h"
#include "tests/support/flip.h"
#include "tests/support/mesh_files.h"

namespace kdray::bench {
namespace {

constexpr int kWidth = 200, kHeight = 150;
constexpr int kRuns = 5;
// A picture of more samples than this is timed once: it takes long enough.
constexpr int kSamplesTimedOften = 64;

core::Scene LoadScene(const std::string& name) {
  const auto folder = test::MeshFolder();
  if (!folder) {
    std::cerr << "bench_images: no mesh collection: set KDRAY_MESHES\n";
    std::exit(1);
  }
  core::Result<core::ParsedMesh> parsed =
      core::ParseMesh(test::ReadFileBytes(*folder / name), core::CancelToken());
  if (!parsed.ok()) {
    std::cerr << "bench_images: " << name << ": " << parsed.error().message << "\n";
    std::exit(1);
  }
  auto mesh = std::make_shared<const core::TriangleMesh>(std::move(parsed->mesh));
  core::Result<core::Tree> tree = core::BuildTree(*mesh, core::BuildKind::kKdSah);
  if (!tree.ok()) std::exit(1);
  return {mesh, std::make_shared<const core::Tree>(*std::move(tree))};
}

struct Rendered {
  test::LinearImage image;      ///< over white
  std::vector<float> coverage;  ///< of each pixel
  double samples = 0;
  double seconds = 0;  ///< the middle of some runs
};

Rendered Render(const core::Scene& scene, core::RenderSpec spec, int runs) {
  spec.width = kWidth;
  spec.height = kHeight;
  spec.background = core::Background{.transparent = true};
  std::vector<double> seconds;
  Rendered rendered;
  for (int run = 0; run < runs; ++run) {
    const auto start = std::chrono::steady_clock::now();
    core::Result<core::RenderedImage> image = core::Render(scene, spec);
    seconds.push_back(
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
    if (!image.ok()) {
      std::cerr << "bench_images: " << image.error().message << "\n";
      std::exit(1);
    }
    rendered = {{kWidth, kHeight, {}}, {}, static_cast<double>(image->samples), 0};
    const auto values = std::get<core::Film<float>>(image->values).values();
    for (std::size_t i = 0; i < values.size(); i += 4) {
      for (std::size_t c = 0; c < 3; ++c) {
        rendered.image.rgb.push_back(std::min(values[i + c] + (1 - values[i + 3]), 1.0f));
      }
      rendered.coverage.push_back(values[i + 3]);
    }
  }
  std::nth_element(seconds.begin(), seconds.begin() + runs / 2, seconds.end());
  rendered.seconds = seconds[static_cast<std::size_t>(runs / 2)];
  return rendered;
}

double RootMeanSquare(const test::LinearImage& a, const test::LinearImage& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.rgb.size(); ++i) {
    const double difference = static_cast<double>(a.rgb[i]) - static_cast<double>(b.rgb[i]);
    sum += difference * difference;
  }
  return std::sqrt(sum / static_cast<double>(a.rgb.size()));
}

/// Pixels through which the background shows although the mesh covers all of them and their
/// neighbours: away from outlines, which no number of samples tells for certain.
int Cracks(const Rendered& image, const Rendered& reference) {
  const auto is_covered = [&](int x, int y) {
    return reference.coverage[static_cast<std::size_t>(y * kWidth + x)] == 1;
  };
  int cracks = 0;
  for (int y = 1; y + 1 < kHeight; ++y) {
    for (int x = 1; x + 1 < kWidth; ++x) {
      if (image.coverage[static_cast<std::size_t>(y * kWidth + x)] == 1) continue;
      bool covered = true;
      for (int i = 0; i < 9; ++i) covered = covered && is_covered(x - 1 + i % 3, y - 1 + i / 3);
      cracks += covered ? 1 : 0;
    }
  }
  return cracks;
}

void Print(const std::string& series, const Rendered& image, const Rendered& reference) {
  std::printf("%s,%.6g,%.6g,%.6g,%.6g,%d\n", series.c_str(), image.samples, image.seconds,
              RootMeanSquare(image.image, reference.image),
              test::MeanFlip(image.image, reference.image), Cracks(image, reference));
  std::fflush(stdout);
}

void Run(const std::string& mesh, int reference_samples) {
  const int most_samples = reference_samples / 8;
  const core::Scene scene = LoadScene(mesh);
  std::cerr << "bench_images: the reference, " << reference_samples << " samples a pixel\n";
  core::RenderSpec spec;
  spec.precision = core::Precision::kExact;
  spec.samples = reference_samples;
  spec.seed = 1;  // other positions than those of the images
  const Rendered reference = Render(scene, spec, 1);
  std::printf("series,samples,seconds,rmse,flip,cracks\n");
  spec.seed = 2;
  for (const core::Precision precision : core::kAllPrecisions) {
    const std::string name(core::Name(precision));
    std::cerr << "bench_images: " << name << "\n";
    spec.precision = precision;
    for (int samples = 2; samples <= most_samples; samples *= 2) {
      spec.samples = samples;
      Print(name, Render(scene, spec, samples <= kSamplesTimedOften ? kRuns : 1), reference);
    }
  }
  std::cerr << "bench_images: max_noise\n";
  spec.precision = core::Precision::kWatertight;
  spec.samples = 1;
  spec.max_samples = 4 * most_samples;
  for (const double noise : {0.1, 0.05, 0.03, 0.02, 0.01, 0.005}) {
    spec.max_noise = noise;
    Print("max_noise (watertight)", Render(scene, spec, kRuns), reference);
  }
}

}  // namespace
}  // namespace kdray::bench

int main(int argc, char** argv) {
  const std::string mesh = argc > 1 ? argv[1] : "stanford_bunny_69k_ascii.ply";
  const int reference_samples = argc > 2 ? std::atoi(argv[2]) : 4096;
  if (reference_samples < 32) {
    std::cerr << "bench_images: the reference needs 32 samples and more\n";
    return 2;
  }
  kdray::core::Arena arena(static_cast<int>(std::thread::hardware_concurrency()));
  arena.Run([&] { kdray::bench::Run(mesh, reference_samples); });
}
