// SPDX-License-Identifier: Apache-2.0
// Ambient occlusion, against form factors.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <stdexcept>

#include "core/base/parallel.h"
#include "core/render/picture.h"
#include "core/render/renderer.h"
#include "core/render/shader.h"
#include "tests/support/scenes.h"
#include "tests/support/shapes.h"

namespace kdray::core {
namespace {

using ::kdray::test::MakeScene;

RenderedImage RenderOk(const Scene& scene, const RenderSpec& spec) {
  Result<RenderedImage> image = Render(scene, spec);
  if (!image.ok()) throw std::runtime_error(image.error().message);
  return *std::move(image);
}

const Film<float>& Floats(const RenderedImage& image) {
  return std::get<Film<float>>(image.values);
}

bool SameBytes(const RenderedImage& a, const RenderedImage& b) {
  const auto x = Floats(a).values();
  const auto y = Floats(b).values();
  return x.size() == y.size() && std::memcmp(x.data(), y.data(), x.size_bytes()) == 0;
}

// A floor, z = 0, and a wall, x = 0, of this height, both very long.
Scene Corner(double wall_height) {
  constexpr double kFar = 1000;
  MeshData mesh;
  mesh.vertices = {{0, -kFar, 0}, {kFar, -kFar, 0},        {kFar, kFar, 0},
                   {0, kFar, 0},  {0, -kFar, wall_height}, {0, kFar, wall_height}};
  mesh.triangles = {{0, 1, 2}, {0, 2, 3}, {0, 3, 5}, {0, 5, 4}};
  return MakeScene(mesh);
}

// One pixel that sees (x, 0, 0) from above, no larger than 1e-3.
RenderSpec OnFloor(double x, int samples) {
  RenderSpec spec = {.width = 1, .height = 1, .mode = RenderMode::kAmbientOcclusion};
  spec.camera = {.projection = Projection::kOrthographic,
                 .eye = Vec3d{x, 0, 50},
                 .target = Vec3d{x, 0, 0},
                 .up = Vec3d{0, 1, 0},
                 .view_height = 1e-4};
  spec.samples = samples;
  spec.ao_radius = 500.0;
  return spec;
}

TEST(AmbientOcclusion, APlaneSeesAllItsSurroundings) {
  const Scene scene = MakeScene(test::Grid(4, 2, 0.5));
  RenderSpec spec = {.width = 32, .height = 32, .mode = RenderMode::kAmbientOcclusion};
  for (const Precision precision : kAllPrecisions) {
    spec.precision = precision;
    spec.samples = std::nullopt;
    const RenderedImage image = RenderOk(scene, spec);
    for (const float value : Floats(image).values()) ASSERT_EQ(value, 1.0f);
    EXPECT_EQ(image.samples, 16);
    EXPECT_EQ(image.counts.camera_rays, 16u * 32u * 32u);
    EXPECT_GT(image.counts.occlusion_rays, 16u * 100u);
    EXPECT_LE(image.counts.occlusion_rays, image.counts.camera_rays);
    EXPECT_EQ(image.counts.shadow_rays, 0u);
  }
}

TEST(AmbientOcclusion, AWallHidesItsFormFactor) {
  // Of a floor at distance 1, a wall of height h and any length takes (1 - cos(atan h)) / 2.
  for (const double height : {0.5, 1.0, 3.0}) {
    const Scene scene = Corner(height);
    const double expected = 1 - 0.5 * (1 - std::cos(std::atan(height)));
    EXPECT_NEAR(Floats(RenderOk(scene, OnFloor(1, 4096)))(0, 0)[0], expected, 0.004) << height;
  }
}

TEST(AmbientOcclusion, SurfacesBeyondTheRadiusDoNotCount) {
  const Scene scene = Corner(1e3);
  RenderSpec spec = OnFloor(1, 256);
  spec.ao_radius = 0.999;
  EXPECT_EQ(Floats(RenderOk(scene, spec))(0, 0)[0], 1.0f);
  spec.ao_radius = 500;
  EXPECT_NEAR(Floats(RenderOk(scene, spec))(0, 0)[0], 0.5, 0.02);
}

TEST(AmbientOcclusion, LooksFromTheSideOfTheViewer) {
  // From within a closed box everything near is hidden, whatever the order of its corners.
  const Scene scene = MakeScene(test::Cube({0, 0, 0}, 1));
  RenderSpec spec = {.width = 9, .height = 9, .mode = RenderMode::kAmbientOcclusion};
  spec.camera = {.eye = Vec3d{0.1, 0.2, 0.3}, .target = Vec3d{1, 0.5, 0.2}};
  spec.ao_radius = 10;
  const RenderedImage image = RenderOk(scene, spec);
  for (const float value : Floats(image).values()) EXPECT_EQ(value, 0.0f);
}

TEST(AmbientOcclusion, IsDecidedByItsSeedAlone) {
  const Scene scene = MakeScene(test::BumpySphere({0, 0, 0}, 1, 20, 30, 0.3));
  RenderSpec spec = {.width = 70, .height = 50, .mode = RenderMode::kAmbientOcclusion};
  spec.samples = std::nullopt;
  spec.ao_radius = 0.3;
  const RenderedImage one = RenderOk(scene, spec);
  Arena(3).Run([&] { EXPECT_TRUE(SameBytes(one, RenderOk(scene, spec))); });
  spec.region = Region{13, 7, 61, 42};
  const RenderedImage part = RenderOk(scene, spec);
  for (int y = 7; y < 42; ++y) {
    for (int x = 13; x < 61; ++x) ASSERT_EQ(Floats(part)(x, y)[0], Floats(one)(x, y)[0]);
  }
  spec.region.reset();
  spec.seed = 1;
  EXPECT_FALSE(SameBytes(one, RenderOk(scene, spec)));
}

TEST(AmbientOcclusion, MissesAreOneAndHaveNoCoverage) {
  const Scene scene = MakeScene(test::Cube({0, 0, 0}, 1));
  RenderSpec spec = {.width = 4, .height = 4, .mode = RenderMode::kAmbientOcclusion};
  spec.camera = {.eye = Vec3d{0, 0, 9}, .target = Vec3d{0, 0, 99}};
  spec.background = Background{.color = {0.2f, 0.4f, 0.6f}};
  const RenderedImage image = RenderOk(scene, spec);
  for (const float value : Floats(image).values()) EXPECT_EQ(value, 1.0f);
  for (const float share : image.coverage->values()) EXPECT_EQ(share, 0.0f);
  const Picture picture = MakePicture(image);
  EXPECT_EQ(picture.pixels[0], 51);
  EXPECT_EQ(picture.pixels[1], 102);
  EXPECT_EQ(picture.pixels[2], 153);
}

TEST(AmbientOcclusion, DirectionsHaveTheDensityOfTheCosine) {
  for (const Vec3d& normal : {Vec3d{0, 0, 1}, Vec3d{0, 0, -1}, Normalized(Vec3d{1, -2, 3}),
                              Normalized(Vec3d{-3, 1, -1e-9})}) {
    Vec3d sum;
    double squares = 0;
    constexpr int kSide = 256;
    for (int i = 0; i < kSide; ++i) {
      for (int j = 0; j < kSide; ++j) {
        const auto word = [](int k) { return (static_cast<std::uint32_t>(k) << 24) + (1u << 23); };
        const Vec3d d = CosineDirection(normal, {word(i), word(j)});
        ASSERT_NEAR(Length(d), 1, 1e-9);
        ASSERT_GE(Dot(d, normal), 0);
        sum = sum + d;
        squares += std::pow(Dot(d, normal), 2);
      }
    }
    // Means of the cosine-weighted hemisphere: the normal times 2/3; 1/2 of the squared cosine.
    const double share = 1.0 / (kSide * kSide);
    EXPECT_NEAR(Length(sum * share - normal * (2.0 / 3)), 0, 2e-4);
    EXPECT_NEAR(squares * share, 0.5, 1e-4);
  }
}

TEST(AmbientOcclusion, RefusesARadiusThatIsNotPositive) {
  const Scene scene = MakeScene(test::Cube({0, 0, 0}, 1));
  for (const double radius : {0.0, -1.0, HUGE_VAL, std::nan("")}) {
    RenderSpec spec = {.width = 2, .height = 2, .mode = RenderMode::kAmbientOcclusion};
    spec.ao_radius = radius;
    EXPECT_EQ(Render(scene, spec).error().field, "ao_radius");
  }
}

}  // namespace
}  // namespace kdray::core
