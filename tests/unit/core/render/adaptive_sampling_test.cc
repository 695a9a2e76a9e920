// SPDX-License-Identifier: Apache-2.0
// Images whose pixels decide how many samples they take.
#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <cstring>
#include <vector>

#include "core/base/parallel.h"
#include "core/render/pixel_sums.h"
#include "core/render/renderer.h"
#include "tests/support/scenes.h"
#include "tests/support/shapes.h"

namespace kdray::core {
namespace {

using ::kdray::test::MakeScene;
using std::chrono::milliseconds;

const Scene& Sphere() {
  static const Scene scene = MakeScene(test::IcoSphere({0, 0, 0}, 1, 3));
  return scene;
}

RenderedImage RenderOk(const RenderSpec& spec) {
  Result<RenderedImage> image = Render(Sphere(), spec);
  if (!image.ok()) throw std::runtime_error(image.error().message);
  return *std::move(image);
}

std::span<const float> Values(const RenderedImage& image) {
  return std::get<Film<float>>(image.values).values();
}

bool SameBytes(const RenderedImage& a, const RenderedImage& b) {
  return Values(a).size() == Values(b).size() &&
         std::memcmp(Values(a).data(), Values(b).data(), Values(a).size_bytes()) == 0;
}

double RootMeanSquare(const RenderedImage& a, const RenderedImage& b) {
  double sum = 0;
  for (std::size_t i = 0; i < Values(a).size(); ++i) {
    sum += std::pow(static_cast<double>(Values(a)[i]) - static_cast<double>(Values(b)[i]), 2);
  }
  return std::sqrt(sum / static_cast<double>(Values(a).size()));
}

TEST(PixelSums, NoiseIsTheStandardErrorOfTheMean) {
  PixelSums pixel;
  for (const double y : {1.0, 3.0, 5.0, 7.0}) {
    pixel.AddLuminance(y);
    ++pixel.samples;
  }
  // Sample variance 20/3, of the mean a quarter of that.
  EXPECT_DOUBLE_EQ(pixel.Noise(), std::sqrt(20.0 / 3 / 4));
  PixelSums one;
  one.samples = 1;
  EXPECT_TRUE(std::isinf(one.Noise()));
}

TEST(AdaptiveSampling, PixelsWithoutNoiseStopAtSixteen) {
  // One flat colour: inside the sphere's silhouette of a single face, seen from near.
  RenderSpec spec = {.width = 8, .height = 8, .max_noise = 1e-3};
  spec.camera = {.eye = Vec3d{0, 0, 50}, .target = Vec3d{0, 0, 60}};  // nothing is seen
  const RenderedImage image = RenderOk(spec);
  EXPECT_EQ(image.samples, kMinAdaptiveSamples);
  EXPECT_EQ(image.stopped, Stopped::kNoise);
  EXPECT_EQ(image.noise, 0.0);
}

TEST(AdaptiveSampling, EdgesTakeMoreSamplesThanFaces) {
  RenderSpec spec = {.width = 64, .height = 64, .max_noise = 0.02};
  const RenderedImage image = RenderOk(spec);
  EXPECT_EQ(image.stopped, Stopped::kNoise);
  EXPECT_GT(image.samples, kMinAdaptiveSamples);
  EXPECT_LT(image.samples, 1024);
  EXPECT_LT(image.counts.camera_rays, 200u * 64u * 64u);
  ASSERT_TRUE(image.noise);
  EXPECT_LT(*image.noise, 0.02);
  EXPECT_GT(*image.noise, 0);
}

TEST(AdaptiveSampling, LessNoiseIsNearerToTheTruth) {
  RenderSpec spec = {.width = 48, .height = 48};
  spec.samples = 4096;
  const RenderedImage truth = RenderOk(spec);
  spec.samples = 1;
  spec.seed = 5;
  double previous = 1;
  for (const double noise : {0.1, 0.03, 0.01}) {
    spec.max_noise = noise;
    const double error = RootMeanSquare(RenderOk(spec), truth);
    EXPECT_LT(error, previous);
    // The standard error is that of random samples; stratified ones do better.
    EXPECT_LT(error, noise);
    previous = error;
  }
}

TEST(AdaptiveSampling, MaxSamplesEndsWhatNoiseDoesNot) {
  RenderSpec spec = {.width = 32, .height = 32, .max_noise = 1e-9};
  spec.max_samples = 24;
  const RenderedImage image = RenderOk(spec);
  EXPECT_EQ(image.stopped, Stopped::kDone);
  EXPECT_GT(*image.noise, 1e-9);
  EXPECT_GT(image.samples, kMinAdaptiveSamples);
  EXPECT_LE(image.samples, 24);
  spec.max_samples = 4;
  EXPECT_EQ(RenderOk(spec).samples, 4);
}

TEST(AdaptiveSampling, APixelThatTookAllSamplesHasTheBitsOfTheFixedImage) {
  for (const RenderMode mode : {RenderMode::kShaded, RenderMode::kNormal}) {
    RenderSpec fixed = {.width = 40, .height = 30, .mode = mode, .samples = 50, .seed = 3};
    RenderSpec adaptive = fixed;
    adaptive.samples = 1;
    adaptive.max_samples = 50;
    adaptive.budget = milliseconds(600000);  // no pixel stops before
    const RenderedImage image = RenderOk(adaptive);
    EXPECT_TRUE(SameBytes(image, RenderOk(fixed)));
    EXPECT_EQ(image.stopped, Stopped::kDone);
    EXPECT_EQ(image.samples, 50);
  }
}

TEST(AdaptiveSampling, RegionsPutTogetherEqualTheWholeForAnyNumberOfThreads) {
  for (const RenderMode mode : {RenderMode::kShaded, RenderMode::kNormal}) {
    RenderSpec spec = {
        .width = 50, .height = 37, .mode = mode, .cells_depth = 3, .max_noise = 0.03};
    const RenderedImage whole = RenderOk(spec);
    const auto& pixels = std::get<Film<float>>(whole.values);
    for (const Region region :
         {Region{0, 0, 13, 37}, Region{13, 0, 50, 5}, Region{13, 5, 50, 37}}) {
      spec.region = region;
      Result<RenderedImage> part = Error{};
      Arena(3).Run([&] { part = Render(Sphere(), spec); });
      ASSERT_TRUE(part.ok());
      const auto& film = std::get<Film<float>>(part->values);
      for (int y = region.y0; y < region.y1; ++y) {
        for (int x = region.x0; x < region.x1; ++x) {
          for (std::size_t c = 0; c < film(x, y).size(); ++c) {
            ASSERT_EQ(film(x, y)[c], pixels(x, y)[c]) << x << "," << y;
          }
        }
      }
    }
  }
}

TEST(AdaptiveSampling, ABudgetEndsTheImageAndStillFillsIt) {
  RenderSpec spec = {.width = 200, .height = 150};
  spec.max_samples = 65536;
  spec.budget = milliseconds(60);
  const auto start = std::chrono::steady_clock::now();
  const RenderedImage image = RenderOk(spec);
  EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(20));
  EXPECT_EQ(image.stopped, Stopped::kBudget);
  EXPECT_GE(image.samples, 1);
  EXPECT_LT(image.samples, 65536);
  // Background is white, the mesh is not black: no pixel was left out.
  for (std::size_t i = 0; i < Values(image).size(); i += 4) {
    EXPECT_GT(Values(image)[i], 0) << "pixel " << i / 4;
    EXPECT_EQ(Values(image)[i + 3], 1);
  }
}

TEST(AdaptiveSampling, ALargeBudgetLetsNoiseEndIt) {
  RenderSpec spec = {.width = 32, .height = 32, .max_noise = 0.05};
  const RenderedImage without = RenderOk(spec);
  spec.budget = milliseconds(600000);
  const RenderedImage image = RenderOk(spec);
  EXPECT_EQ(image.stopped, Stopped::kNoise);
  EXPECT_TRUE(SameBytes(image, without));
}

TEST(AdaptiveSampling, NumbersOfPixelsTakeOneSample) {
  for (const RenderMode mode : {RenderMode::kDepth, RenderMode::kTriangle}) {
    RenderSpec spec = {.width = 16, .height = 16, .mode = mode, .max_noise = 0.1};
    spec.budget = milliseconds(1000);
    const RenderedImage image = RenderOk(spec);
    EXPECT_EQ(image.samples, 1);
    EXPECT_EQ(image.noise, std::nullopt);
    EXPECT_EQ(image.stopped, Stopped::kDone);
  }
}

TEST(AdaptiveSampling, FixedImagesSayTheirSamplesAndNoNoise) {
  const RenderedImage image = RenderOk({.width = 16, .height = 16, .samples = 7});
  EXPECT_EQ(image.samples, 7);
  EXPECT_EQ(image.noise, std::nullopt);
  EXPECT_EQ(image.stopped, Stopped::kDone);
}

TEST(AdaptiveSampling, RefusesWhatCannotBe) {
  const auto wrong_field = [](RenderSpec spec) { return Render(Sphere(), spec).error().field; };
  EXPECT_EQ(wrong_field({.max_noise = 0.0}), "max_noise");
  EXPECT_EQ(wrong_field({.max_noise = HUGE_VAL}), "max_noise");
  EXPECT_EQ(wrong_field({.max_samples = 0}), "max_samples");
  EXPECT_EQ(wrong_field({.budget = milliseconds(0)}), "budget_ms");
}

}  // namespace
}  // namespace kdray::core
