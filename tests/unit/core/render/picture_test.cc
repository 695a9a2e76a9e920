// SPDX-License-Identifier: Apache-2.0
#include "core/render/picture.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <span>
#include <vector>

#include "core/render/depth_range.h"
#include "core/render/heat_map.h"
#include "core/render/shading.h"
#include "tests/support/scenes.h"
#include "tests/support/shapes.h"

namespace kdray::core {
namespace {

using Codes = std::vector<std::uint8_t>;

constexpr std::array kAllModes = {RenderMode::kShaded, RenderMode::kNormal, RenderMode::kDepth,
                                  RenderMode::kTriangle, RenderMode::kCost};

RenderedImage RenderOk(const Scene& scene, const RenderSpec& spec) {
  Result<RenderedImage> image = Render(scene, spec);
  if (!image.ok()) throw std::runtime_error(image.error().message);
  return *std::move(image);
}

Codes PixelAt(const Picture& picture, int x, int y) {
  const auto channels = static_cast<std::size_t>(picture.channels);
  const std::size_t at = (static_cast<std::size_t>(y) * static_cast<std::size_t>(picture.width) +
                          static_cast<std::size_t>(x)) *
                         channels;
  const auto first = picture.pixels.begin() + static_cast<std::ptrdiff_t>(at);
  return Codes(first, first + static_cast<std::ptrdiff_t>(channels));
}

// A unit cube seen from the front fills the middle half of the picture: pixels 4..11 of 16.
RenderSpec FrontSpec(RenderMode mode) {
  RenderSpec spec = {.width = 16, .height = 16, .mode = mode};
  spec.camera = {.projection = Projection::kOrthographic,
                 .eye = Vec3d{0, 0, 3},
                 .target = Vec3d{},
                 .view_height = 4.0};
  return spec;
}
Scene FrontCube() { return test::MakeScene(test::Cube({0, 0, 0}, 1)); }

TEST(Picture, ShowsTheColoursItWasGiven) {
  // A face square to the view under a headlight is as light as its colour.
  RenderSpec spec = FrontSpec(RenderMode::kShaded);
  spec.color = {200 / 255.0f, 100 / 255.0f, 3 / 255.0f};
  spec.background = Background{.color = {10 / 255.0f, 20 / 255.0f, 30 / 255.0f}};
  const Picture picture = MakePicture(RenderOk(FrontCube(), spec));
  EXPECT_EQ(PixelAt(picture, 8, 8), (Codes{200, 100, 3}));
  EXPECT_EQ(PixelAt(picture, 1, 8), (Codes{10, 20, 30}));
}

TEST(Picture, KeepsTheColourOfHalfCoveredPixelsAndHalvesTheirAlpha) {
  RenderSpec spec = FrontSpec(RenderMode::kShaded);
  spec.camera.eye = Vec3d{0.125, 0, 3};  // the cube's edges now halve columns 3 and 11
  spec.camera.target = Vec3d{0.125, 0, 0};
  spec.samples = 64;
  spec.color = {200 / 255.0f, 100 / 255.0f, 3 / 255.0f};
  spec.background = Background{.transparent = true};
  const Picture picture = MakePicture(RenderOk(FrontCube(), spec));
  EXPECT_EQ(PixelAt(picture, 8, 8), (Codes{200, 100, 3, 255}));
  EXPECT_EQ(PixelAt(picture, 3, 8), (Codes{200, 100, 3, 128}));
  EXPECT_EQ(PixelAt(picture, 1, 8), (Codes{0, 0, 0, 0}));
}

TEST(Picture, ShowsNormalsAsCodes) {
  const Picture picture = MakePicture(RenderOk(FrontCube(), FrontSpec(RenderMode::kNormal)));
  EXPECT_EQ(PixelAt(picture, 8, 8), (Codes{128, 128, 255}));
  EXPECT_EQ(PixelAt(picture, 1, 8), (Codes{0, 0, 0}));
}

TEST(Picture, ShowsNearDepthsLightAndFarOnesDark) {
  // A ramp from z = 1 at the left to z = -1 at the right.
  MeshData ramp;
  ramp.vertices = {{-2, -2, 1}, {2, -2, -1}, {2, 2, -1}, {-2, 2, 1}};
  ramp.triangles = {{0, 1, 2}, {0, 2, 3}};
  RenderSpec spec = FrontSpec(RenderMode::kDepth);
  const Picture picture = MakePicture(RenderOk(test::MakeScene(ramp), spec));
  for (int x = 0; x < 16; ++x) {
    // From 255 at the nearest pixel centre to 1 at the farthest.
    const Codes pixel = PixelAt(picture, x, 8);
    EXPECT_EQ(pixel[0], 255 - std::round(254 * x / 15.0));
    EXPECT_EQ(pixel[1], pixel[0]);
    EXPECT_EQ(pixel[2], pixel[0]);
  }
  spec.camera.target = Vec3d{0, 0, 9};  // away from it
  EXPECT_EQ(PixelAt(MakePicture(RenderOk(test::MakeScene(ramp), spec)), 8, 8), (Codes{0, 0, 0}));
}

TEST(Picture, ShowsADepthImageOfAFlatMeshLight) {
  RenderSpec spec = FrontSpec(RenderMode::kDepth);
  const Picture picture = MakePicture(RenderOk(test::MakeScene(test::Grid(2, 2, 0)), spec));
  EXPECT_EQ(PixelAt(picture, 9, 6), (Codes{255, 255, 255}));
}

TEST(Picture, ShowsDepthsByTheRangeThatItIsGiven) {
  const RenderSpec spec = FrontSpec(RenderMode::kDepth);  // the cube's front is 2 away
  RenderedImage image = RenderOk(FrontCube(), spec);
  for (const auto& [range, grey] : {std::pair{DepthRange{1, 3}, 128},
                                    {DepthRange{2, 9}, 255},
                                    {DepthRange{3, 9}, 255},
                                    {DepthRange{0, 1}, 1},
                                    {DepthRange{2, 2}, 255},
                                    {DepthRange{-1e308, 1e308}, 128}}) {
    image.depth_range = range;
    const auto code = static_cast<std::uint8_t>(grey);
    EXPECT_EQ(PixelAt(MakePicture(image), 8, 8), (Codes{code, code, code})) << range.far;
    EXPECT_EQ(PixelAt(MakePicture(image), 0, 0), (Codes{0, 0, 0}));
  }
}

TEST(Picture, ShowsCostsInTheColoursOfTheScale) {
  const RenderedImage image = RenderOk(FrontCube(), FrontSpec(RenderMode::kCost));
  const Picture picture = MakePicture(image);
  const auto cost = std::get<Film<std::int32_t>>(image.values)(8, 8);
  const Rgb c = HeatColor(cost[0], cost[1]);
  EXPECT_EQ(PixelAt(picture, 8, 8), (Codes{ToUnorm8(c.r), ToUnorm8(c.g), ToUnorm8(c.b)}));

  EXPECT_EQ(HeatColor(0, 0), (Rgb{0, 0, 0}));
  EXPECT_EQ(HeatColor(31, 0), (Rgb{0.8f, 0.12f, 0.3f}));
  EXPECT_EQ(HeatColor(1000, 23), (Rgb{1, 1, 0.85f}));
  EXPECT_EQ(HeatColor(2'000'000'000, 2'000'000'000), (Rgb{1, 1, 0.85f}));
}

TEST(Picture, ShowsTrianglesInTheirColours) {
  const RenderedImage image = RenderOk(FrontCube(), FrontSpec(RenderMode::kTriangle));
  const Picture picture = MakePicture(image);
  for (const auto& [x, y] : {std::pair{5, 8}, {8, 5}, {10, 8}, {8, 10}}) {
    const std::int32_t id = std::get<Film<std::int32_t>>(image.values)(x, y)[0];
    ASSERT_GE(id, 0);
    const Rgb c = HashedColor(static_cast<PrimitiveId>(id));
    EXPECT_EQ(PixelAt(picture, x, y), (Codes{ToUnorm8(c.r), ToUnorm8(c.g), ToUnorm8(c.b)}));
  }
}

TEST(Picture, ShowsTheBackgroundAskedForInEveryMode) {
  for (const RenderMode mode : kAllModes) {
    RenderSpec spec = FrontSpec(mode);
    spec.background = Background{.color = {1, 0, 128 / 255.0f}};
    EXPECT_EQ(PixelAt(MakePicture(RenderOk(FrontCube(), spec)), 0, 0), (Codes{255, 0, 128}));
    spec.background = Background{.transparent = true};
    const Picture picture = MakePicture(RenderOk(FrontCube(), spec));
    EXPECT_EQ(picture.channels, 4);
    EXPECT_EQ(PixelAt(picture, 0, 0), (Codes{0, 0, 0, 0}));
    EXPECT_EQ(PixelAt(picture, 8, 8)[3], 255);
  }
}

TEST(Picture, OfARegionEqualsThatPartOfTheWhole) {
  const Scene scene = test::MakeScene(test::BumpySphere({0, 0, 0}, 1, 20, 30, 0.3));
  for (const RenderMode mode : kAllModes) {
    RenderSpec spec = {.width = 90, .height = 70, .mode = mode, .samples = 3};
    spec.cells_depth = 4;
    const Picture whole = MakePicture(RenderOk(scene, spec));
    spec.region = Region{40, 20, 77, 61};
    RenderedImage image = RenderOk(scene, spec);
    if (mode == RenderMode::kDepth) image.depth_range = *RangeOfWholeImage(scene, image, {});
    const Picture part = MakePicture(image);
    ASSERT_EQ(part.width, 37);
    ASSERT_EQ(part.height, 41);
    for (int y = 0; y < part.height; ++y) {
      for (int x = 0; x < part.width; ++x) {
        ASSERT_EQ(PixelAt(part, x, y), PixelAt(whole, x + 40, y + 20));
      }
    }
  }
}

TEST(Picture, HasTheLinesOfEdgesInEveryModeAndRegion) {
  const Scene scene = test::MakeScene(test::Cube({0, 0, 0}, 1));
  for (const RenderMode mode : kAllModes) {
    RenderSpec spec = FrontSpec(mode);
    const Picture plain = MakePicture(RenderOk(scene, spec));
    spec.edges = [](PrimitiveId) { return kAllSides; };
    const Picture lines = MakePicture(RenderOk(scene, spec));
    EXPECT_NE(PixelAt(lines, 4, 8), PixelAt(plain, 4, 8)) << "the left edge";
    EXPECT_NE(PixelAt(lines, 9, 9), PixelAt(lines, 9, 5)) << "a diagonal";
    spec.region = Region{3, 5, 11, 16};
    const Picture part = MakePicture(RenderOk(scene, spec));
    for (int y = 0; y < part.height; ++y) {
      for (int x = 0; x < part.width; ++x) {
        ASSERT_EQ(PixelAt(part, x, y), PixelAt(lines, x + 3, y + 5));
      }
    }
  }
}

TEST(Picture, HasTheLinesOfCellsInEveryMode) {
  for (const RenderMode mode : kAllModes) {
    RenderSpec spec = {.width = 64, .height = 64, .mode = mode};
    const Scene scene = test::MakeScene(test::IcoSphere({0, 0, 0}, 1, 3));
    const Picture plain = MakePicture(RenderOk(scene, spec));
    spec.cells_depth = 2;
    EXPECT_NE(MakePicture(RenderOk(scene, spec)), plain);
  }
}

}  // namespace
}  // namespace kdray::core
