// SPDX-License-Identifier: Apache-2.0
// The default number of samples, and the pixel filter: silhouettes are smooth, regions join.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstring>
#include <numbers>
#include <set>
#include <stdexcept>

#include "core/base/parallel.h"
#include "core/render/pixel_filter.h"
#include "core/render/pixel_order.h"
#include "core/render/renderer.h"
#include "tests/support/scenes.h"
#include "tests/support/shapes.h"

namespace kdray::core {
namespace {

using ::kdray::test::MakeScene;

constexpr std::array kSampledModes = {RenderMode::kShaded, RenderMode::kNormal,
                                      RenderMode::kAmbientOcclusion};

RenderedImage RenderOk(const Scene& scene, const RenderSpec& spec) {
  Result<RenderedImage> image = Render(scene, spec);
  if (!image.ok()) throw std::runtime_error(image.error().message);
  return *std::move(image);
}

const Film<float>& Floats(const RenderedImage& image) {
  return std::get<Film<float>>(image.values);
}

template <class T>
bool SameBytes(std::span<const T> a, std::span<const T> b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size_bytes()) == 0;
}

// A disc of radius 1 across the z axis.
Scene Disc() {
  constexpr int kCorners = 720;
  MeshData mesh;
  mesh.vertices.push_back({0, 0, 0});
  for (int i = 0; i < kCorners; ++i) {
    const double angle = 2 * std::numbers::pi * i / kCorners;
    mesh.vertices.push_back({std::cos(angle), std::sin(angle), 0});
  }
  for (std::uint32_t i = 0; i < kCorners; ++i) {
    mesh.triangles.push_back({0, 1 + i, 1 + (i + 1) % kCorners});
  }
  return MakeScene(mesh);
}

RenderSpec FromAbove(int side, double view_height) {
  RenderSpec spec = {.width = side, .height = side, .samples = std::nullopt};
  spec.camera = {.projection = Projection::kOrthographic,
                 .eye = Vec3d{0.003, 0.001, 10},
                 .target = Vec3d{0.003, 0.001, 0},
                 .up = Vec3d{0, 1, 0},
                 .view_height = view_height};
  spec.background = Background{.transparent = true};
  return spec;
}

TEST(PixelFilter, OffsetsHaveTheDensityOfTheWindow) {
  const PixelFilter& filter = PixelFilter::Get();
  double before = -PixelFilter::kRadiusPx;
  double sum = 0;
  double squares = 0;
  constexpr int kCount = 1 << 16;
  for (int i = 0; i < kCount; ++i) {
    const double share = (i + 0.5) / kCount;
    const double offset =
        static_cast<double>(filter.Offset((static_cast<std::uint32_t>(i) << 16) + (1u << 15)));
    ASSERT_GE(offset, before);
    ASSERT_LE(offset, PixelFilter::kRadiusPx);
    // A piece has the share 2^-10.
    ASSERT_NEAR(PixelFilter::ShareBelow(offset), share, 0x1p-11);
    before = offset;
    sum += offset;
    squares += offset * offset;
  }
  EXPECT_NEAR(sum / kCount, 0, 1e-9);
  // The variance of the window: pi^2 / 3 + 2 (-a1 + a2 / 4 - a3 / 9) / a0, times (1.5 / pi)^2.
  EXPECT_NEAR(squares / kCount, 0.17266, 5e-4);
}

TEST(PixelOrder, HasEachPixelOnceAndEveryFourInASquare) {
  for (const auto& [width, height] : {std::pair{8, 8}, {64, 64}, {1, 1}, {13, 9}, {3, 40}}) {
    const std::vector<std::uint32_t> order = PixelOrder(width, height);
    const std::set<std::uint32_t> all(order.begin(), order.end());
    ASSERT_EQ(all.size(), static_cast<std::size_t>(width * height));
    ASSERT_EQ(*all.rbegin(), static_cast<std::uint32_t>(width * height - 1));
    ASSERT_EQ(order.size(), all.size());
  }
  const std::vector<std::uint32_t> order = PixelOrder(64, 16);
  for (std::size_t i = 0; i < order.size(); i += 16) {
    for (std::size_t k = 0; k < 16; ++k) {
      EXPECT_EQ(order[i + k] % 64 / 4, order[i] % 64 / 4);
      EXPECT_EQ(order[i + k] / 64 / 4, order[i] / 64 / 4);
    }
  }
}

TEST(DefaultSamples, ADiscCoversItsAreaAndItsEdgeIsSmooth) {
  const Scene scene = Disc();
  for (const double height : {3.0, 5.1, 11.0}) {
    const RenderSpec spec = FromAbove(100, height);
    const RenderedImage image = RenderOk(scene, spec);
    EXPECT_EQ(image.samples, kSmoothSamples);
    const double size = height / 100;
    double area = 0;
    for (int j = 0; j < 100; ++j) {
      for (int i = 0; i < 100; ++i) {
        const double alpha = static_cast<double>(Floats(image)(i, j)[3]);
        const double x = (i + 0.5 - 50) * size + 0.003;
        const double y = (50 - j - 0.5) * size + 0.001;
        // The edge is almost straight across the filter.
        const double beyond = (std::hypot(x, y) - 1) / size;
        const double expected = 1 - PixelFilter::ShareBelow(beyond);
        ASSERT_NEAR(alpha, expected, 0.2) << x << ' ' << y;
        area += alpha * size * size;
      }
    }
    const double radius_px = 1 / size;
    // Some 3 pixels across, each off by a tenth, independently.
    const double noise = 0.1 * std::sqrt(3 * 2 * std::numbers::pi * radius_px);
    EXPECT_NEAR(area / std::numbers::pi, 1, 3 * noise / (std::numbers::pi * radius_px * radius_px));
  }
}

TEST(DefaultSamples, APixelHasOneSampleOrSixteenByItsNineCentres) {
  const Scene scene = MakeScene(test::IcoSphere({0, 0, 0}, 1, 1));
  for (const RenderMode mode : {RenderMode::kShaded, RenderMode::kNormal}) {
    RenderSpec spec = {.width = 151, .height = 117, .mode = mode, .samples = std::nullopt};
    spec.background = Background{.transparent = true};
    const RenderedImage image = RenderOk(scene, spec);
    spec.samples = 1;
    const RenderedImage one = RenderOk(scene, spec);
    spec.samples = kSmoothSamples;
    const RenderedImage many = RenderOk(scene, spec);
    const auto is_hit = [&](int x, int y) {
      return (mode == RenderMode::kShaded ? Floats(one)(x, y)[3] : (*one.coverage)(x, y)[0]) != 0;
    };
    int single = 0;
    int smoothed = 0;
    for (int y = 0; y < 117; ++y) {
      for (int x = 0; x < 151; ++x) {
        const bool is_one = SameBytes<float>(Floats(image)(x, y), Floats(one)(x, y));
        const bool is_many = SameBytes<float>(Floats(image)(x, y), Floats(many)(x, y));
        ASSERT_TRUE(is_one || is_many) << x << ' ' << y;
        bool is_silhouette = false;
        for (int v = std::max(y - 1, 0); v < std::min(y + 2, 117); ++v) {
          for (int u = std::max(x - 1, 0); u < std::min(x + 2, 151); ++u) {
            is_silhouette = is_silhouette || is_hit(u, v) != is_hit(x, y);
          }
        }
        ASSERT_TRUE(is_many || !is_silhouette) << x << ' ' << y;
        single += is_one ? 1 : 0;
        smoothed += is_one ? 0 : 1;
      }
    }
    EXPECT_GT(smoothed, 300);
    EXPECT_GT(single, 5000);
  }
}

TEST(DefaultSamples, RegionsPutTogetherEqualTheWholeForAnyNumberOfThreads) {
  const Scene scene = MakeScene(test::BumpySphere({0, 0, 0}, 1, 20, 30, 0.3));
  for (const RenderMode mode : kSampledModes) {
    for (const bool with_lights : {false, true}) {
      RenderSpec spec = {.width = 150, .height = 110, .mode = mode, .samples = std::nullopt};
      spec.cells_depth = 3;
      if (with_lights) {
        spec.lights = {{.kind = LightKind::kPoint, .vector = {3, 3, 3}},
                       {.vector = {1, -1, 0}, .color = {1, 0.5f, 0.2f}}};
        spec.shadows = true;
      }
      const RenderedImage whole = RenderOk(scene, spec);
      EXPECT_EQ(whole.samples, kSmoothSamples);
      Arena(3).Run([&] {
        EXPECT_TRUE(SameBytes(Floats(whole).values(), Floats(RenderOk(scene, spec)).values()));
      });
      for (const Region& region :
           {Region{0, 0, 71, 110}, {71, 0, 150, 33}, {71, 33, 150, 110}, {80, 50, 81, 51}}) {
        spec.region = region;
        const RenderedImage part = RenderOk(scene, spec);
        for (int y = region.y0; y < region.y1; ++y) {
          for (int x = region.x0; x < region.x1; ++x) {
            ASSERT_TRUE(SameBytes<float>(Floats(part)(x, y), Floats(whole)(x, y)));
            if (whole.coverage) {
              ASSERT_EQ((*part.coverage)(x, y)[0], (*whole.coverage)(x, y)[0]);
            }
            if (whole.lines) {
              ASSERT_EQ((*part.lines)(x, y)[0], (*whole.lines)(x, y)[0]);
            }
          }
        }
      }
    }
  }
}

TEST(DefaultSamples, ImagesWithoutAnEdgeTakeOneSample) {
  const Scene scene = Disc();
  RenderSpec spec = FromAbove(60, 0.1);  // within the disc
  const RenderedImage image = RenderOk(scene, spec);
  EXPECT_EQ(image.samples, 1);
  EXPECT_EQ(image.stopped, Stopped::kDone);
  EXPECT_EQ(image.noise, std::nullopt);
  // Each of 4 tiles looks one pixel beyond its border.
  EXPECT_LT(image.counts.camera_rays, 62u * 62u * 11u / 10u);
}

TEST(DefaultSamples, NoiseAndBudgetReplaceTheRule) {
  const Scene scene = Disc();
  RenderSpec spec = FromAbove(40, 3);
  spec.max_noise = 0.01;
  const RenderedImage image = RenderOk(scene, spec);
  EXPECT_GT(image.samples, kSmoothSamples);
  spec.samples = 1;
  EXPECT_TRUE(SameBytes(Floats(image).values(), Floats(RenderOk(scene, spec)).values()));
}

}  // namespace
}  // namespace kdray::core
