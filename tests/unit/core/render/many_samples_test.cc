// SPDX-License-Identifier: Apache-2.0
// What is computed for many samples together has the bits of the plain functions for one.
#include <gtest/gtest.h>

#include <cstdint>
#include <cstring>
#include <optional>
#include <utility>
#include <variant>
#include <vector>

#include "core/render/centre_rays.h"
#include "core/render/framing.h"
#include "core/render/picture.h"
#include "core/render/pixel_filter.h"
#include "core/render/pixel_order.h"
#include "core/render/renderer.h"
#include "core/render/sampler.h"
#include "tests/support/scenes.h"
#include "tests/support/shapes.h"

namespace kdray::core {
namespace {

TEST(ManySamples, CentreRaysAreThoseOfTheCamera) {
  for (const Projection projection :
       {Projection::kPerspective, Projection::kOrthographic, Projection::kSpherical}) {
    CameraSpec spec;
    spec.projection = projection;
    const Camera camera = *ResolveCamera(spec, {{-1, -2, -3}, {3, 2, 1}}, 203, 151);
    const Tile tile = {150, 101, 203, 151};
    std::vector<Ray> rays(tile.pixel_count());
    WriteCentreRays(camera, tile, rays.data());
    auto ray = rays.begin();
    ForEachInPixelOrder(tile.width(), tile.height(), [&](int x, int y) {
      const Ray plain = camera.RayThrough(tile.x0 + x + 0.5, tile.y0 + y + 0.5);
      ASSERT_EQ(std::memcmp(&*ray++, &plain, sizeof(Ray)), 0) << x << ' ' << y;
    });
    EXPECT_EQ(ray, rays.end());
  }
}

TEST(ManySamples, PositionsAndOffsetsInVectorsAreThoseOfOneSample) {
  const PixelFilter& filter = PixelFilter::Get();
  for (const int pixel : {0, 1, 77, 5000}) {
    const PixelSampler sampler(9, pixel, 3 * pixel);
    // Also after the stored positions.
    for (std::uint32_t n = 0; n < 3000; n += 2) {
      const FourWords two = sampler.Two(n);
      const FourFloats offsets = filter.Offsets(two);
      for (std::uint32_t k = 0; k < 2; ++k) {
        const SampleWords one = sampler[n + k];
        ASSERT_EQ(two[2 * k], one.x);
        ASSERT_EQ(two[2 * k + 1], one.y);
        ASSERT_EQ(offsets[2 * k], filter.Offset(one.x));
        ASSERT_EQ(offsets[2 * k + 1], filter.Offset(one.y));
      }
    }
  }
  const FourFloats ends = filter.Offsets(FourWords{0, 0xffffffffu, 0x80000000u, 0x7fffffffu});
  EXPECT_EQ(ends[0], filter.Offset(0));
  EXPECT_EQ(ends[1], filter.Offset(0xffffffffu));
  EXPECT_EQ(ends[2], filter.Offset(0x80000000u));
  EXPECT_EQ(ends[3], filter.Offset(0x7fffffffu));
}

TEST(ManySamples, CodesThatAreMadeTileByTileAreThoseOfTheLight) {
  const Scene scene = test::MakeScene(test::BumpySphere({1, 2, 3}, 2, 20, 30, 0.3));
  for (const std::optional<int> samples :
       {std::optional(1), std::optional(5), std::optional<int>()}) {
    for (const bool transparent : {false, true}) {
      RenderSpec spec = {.width = 150, .height = 90, .samples = samples};
      spec.background = Background{{0.1f, 0.5f, 0.9f}, transparent};
      spec.region = Region{10, 3, 141, 90};
      const RenderedImage light = *Render(scene, spec);
      spec.as_codes = true;
      RenderedImage codes = *Render(scene, spec);
      EXPECT_TRUE(std::get<Film<float>>(codes.values).values().empty());
      EXPECT_EQ(MakePicture(codes), MakePicture(light));
      EXPECT_EQ(*MakePicture(std::move(codes), {}), MakePicture(light));
    }
  }
}

TEST(ManySamples, CodesAreNotMadeWhereLinesAreDrawnOrValuesAreNoLight) {
  const Scene scene = test::MakeScene(test::BumpySphere({1, 2, 3}, 2, 20, 30, 0.3));
  RenderSpec spec = {.width = 50, .height = 40, .cells_depth = 4, .as_codes = true};
  EXPECT_FALSE(Render(scene, spec)->codes);
  spec = {.width = 50, .height = 40, .mode = RenderMode::kNormal, .as_codes = true};
  EXPECT_FALSE(Render(scene, spec)->codes);
}

}  // namespace
}  // namespace kdray::core
