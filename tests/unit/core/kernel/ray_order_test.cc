// SPDX-License-Identifier: Apache-2.0
#include "core/kernel/ray_order.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <span>
#include <vector>

namespace kdray::core {
namespace {

const Bounds3d kUnitBox = {{-1, -1, -1}, {1, 1, 1}};

// A camera's rays in tiles of 8 x 8 pixels; the directions at a row's two ends differ in sign.
std::vector<RayF> TiledCamera(int pixels) {
  std::vector<RayF> rays;
  for (int ty = 0; ty < pixels; ty += 8) {
    for (int tx = 0; tx < pixels; tx += 8) {
      for (int y = ty; y < ty + 8; ++y) {
        for (int x = tx; x < tx + 8; ++x) {
          const auto across = [&](int k) {
            return (2 * static_cast<float>(k) + 1) / static_cast<float>(pixels) - 1;
          };
          rays.push_back({{0, 0, 3}, 0, {across(x), across(y), -1}});
        }
      }
    }
  }
  return rays;
}

// Powers of two are what equal steps through the batch would fail on: each step would land on the
// end of a row of tiles.
TEST(RayOrder, ACamerasRaysAreNotShuffledWhateverThePictureSize) {
  for (const int pixels : {64, 128, 256, 512, 1000, 1024}) {
    EXPECT_FALSE(IsShuffled(std::span<const RayF>(TiledCamera(pixels)), kUnitBox)) << pixels;
  }
}

TEST(RayOrder, RaysInRandomOrderAreShuffled) {
  std::vector<RayF> rays = TiledCamera(256);
  std::mt19937 engine(7);
  std::shuffle(rays.begin(), rays.end(), engine);
  EXPECT_TRUE(IsShuffled(std::span<const RayF>(rays), kUnitBox));
}

TEST(RayOrder, ScatteredRaysFromNeighbouringPointsAreNotShuffledUntilTheyAre) {
  std::mt19937 engine(8);
  std::uniform_real_distribution<float> any(-1, 1);
  std::vector<RayF> rays;
  for (int i = 0; i < 10000; ++i) {
    const float at = static_cast<float>(i) / 10000;
    rays.push_back({{at, 0.5F * at, 0}, 0, {any(engine), any(engine), any(engine)}});
  }
  EXPECT_FALSE(IsShuffled(std::span<const RayF>(rays), kUnitBox));
  std::shuffle(rays.begin(), rays.end(), engine);
  EXPECT_TRUE(IsShuffled(std::span<const RayF>(rays), kUnitBox));
}

TEST(RayOrder, RaysFromASurfaceAreInFewGroupsRandomOnesInMany) {
  std::mt19937 engine(9);
  std::uniform_real_distribution<float> any(-1, 1);
  const auto direction = [&] { return Vec3f{any(engine), any(engine), any(engine)}; };
  std::vector<RayF> from_surface, random;
  for (int i = 0; i < 100000; ++i) {
    from_surface.push_back({{any(engine), any(engine), 0}, 0, direction()});
    random.push_back({{any(engine), any(engine), any(engine)}, 0, direction()});
  }
  // 256 cells of 4,096, and 8 octants: 2,048.
  const double surface_groups = CountGroups(std::span<const RayF>(from_surface), kUnitBox);
  EXPECT_GT(surface_groups, 1400);
  EXPECT_LT(surface_groups, 2900);
  EXPECT_GT(CountGroups(std::span<const RayF>(random), kUnitBox), 10000);

  const std::vector<RayF> same(5000, RayF{{0, 0, 0}, 0, {1, 1, 1}});
  EXPECT_EQ(CountGroups(std::span<const RayF>(same), kUnitBox), 1);
  const std::vector<RayF> invalid(600, RayF{{NAN, 0, 0}, 0, {0, INFINITY, 1}});
  EXPECT_EQ(CountGroups(std::span<const RayF>(invalid), kUnitBox), 1);
}

TEST(RayOrder, OrdersEveryRowOnce) {
  const std::vector<RayF> rays = TiledCamera(64);
  for (const bool by_direction : {false, true}) {
    std::vector<std::uint32_t> rows(1000);
    OrderRays(std::span<const RayF>(rays), kUnitBox, by_direction, 500, rows);
    std::sort(rows.begin(), rows.end());
    for (std::size_t i = 0; i < rows.size(); ++i) EXPECT_EQ(rows[i], 500 + i);
  }
}

}  // namespace
}  // namespace kdray::core
