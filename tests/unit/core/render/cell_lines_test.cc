// SPDX-License-Identifier: Apache-2.0
#include "core/render/cell_lines.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "core/render/framing.h"
#include "tests/support/seed.h"

namespace kdray::core {
namespace {

constexpr LineStyle kPlain = {
    .color = {0, 0, 0}, .width_px = 1.0f, .near_opacity = 1.0f, .far_opacity = 1.0f};

// Looks along -z at the square -10..10 x -10..10, one unit a pixel, from z = 100.
Camera FrontView() {
  return *ResolveCamera({.projection = Projection::kOrthographic,
                         .eye = Vec3d{0, 0, 100},
                         .target = Vec3d{},
                         .view_height = 20.0},
                        {{-1, -1, -1}, {1, 1, 1}}, 20, 20);
}

TreeCell CellOf(const Bounds3d& bounds) {
  TreeCell cell;
  cell.bounds = bounds;
  cell.triangles = 1;
  return cell;
}

std::vector<Hit> Surface(const Region& region, int samples, double depth) {
  Hit hit;
  hit.t = depth;
  if (std::isfinite(depth)) hit.primitive_id = 0;
  return std::vector<Hit>(region.pixel_count() * static_cast<std::size_t>(samples), hit);
}

std::vector<float> DrawAll(const std::vector<TreeCell>& cells, const Camera& camera,
                           const Region& region, double surface_depth,
                           const LineStyle& style = kPlain) {
  const CellLines lines(cells, camera, region, style);
  std::vector<float> opacity(region.pixel_count());
  EXPECT_TRUE(lines.Draw(region, Surface(region, 1, surface_depth), 1, opacity).ok());
  return opacity;
}

constexpr double kNothing = std::numeric_limits<double>::infinity();
const Region kWhole = {0, 0, 20, 20};

TEST(CellLines, DrawTheOutlineOfABoxWhereItProjects) {
  // Edges at x = -5.5 and 4.5, y = 6.5 and -3.5: the middles of columns 4 and 14, rows 3 and 13.
  const std::vector<TreeCell> cells = {CellOf({{-5.5, -3.5, -1}, {4.5, 6.5, 1}})};
  const std::vector<float> opacity = DrawAll(cells, FrontView(), kWhole, kNothing);
  for (int y = 0; y < 20; ++y) {
    for (int x = 0; x < 20; ++x) {
      const bool in_columns = x >= 4 && x <= 14;
      const bool in_rows = y >= 3 && y <= 13;
      const bool on_edge = ((x == 4 || x == 14) && in_rows) || ((y == 3 || y == 13) && in_columns);
      ASSERT_EQ(opacity[static_cast<std::size_t>(y * 20 + x)], on_edge ? 1.0f : 0.0f)
          << x << ' ' << y;
    }
  }
}

TEST(CellLines, ShareALineBetweenThePixelsItRunsBetween) {
  const std::vector<TreeCell> cells = {CellOf({{-6, -30, -1}, {30, 30, 1}})};
  const std::vector<float> opacity = DrawAll(cells, FrontView(), kWhole, kNothing);
  for (std::size_t y = 0; y < 20; ++y) {
    EXPECT_NEAR(opacity[y * 20 + 3], 0.5f, 1e-6f);
    EXPECT_NEAR(opacity[y * 20 + 4], 0.5f, 1e-6f);
    EXPECT_EQ(opacity[y * 20 + 5], 0.0f);
  }
}

TEST(CellLines, AreHiddenBehindASurfaceAndDrawnInFrontOfIt) {
  // One edge ring at depth 95, one at depth 105; the surface at 100 hides the second alone.
  const std::vector<TreeCell> far = {CellOf({{-5.5, -3.5, -5}, {4.5, 6.5, -5}})};
  const std::vector<TreeCell> near = {CellOf({{-5.5, -3.5, 5}, {4.5, 6.5, 5}})};
  const std::vector<float> hidden = DrawAll(far, FrontView(), kWhole, 100);
  EXPECT_EQ(*std::max_element(hidden.begin(), hidden.end()), 0.0f);
  EXPECT_EQ(DrawAll(near, FrontView(), kWhole, 100), DrawAll(near, FrontView(), kWhole, kNothing));
}

TEST(CellLines, InTheSurfaceItselfAreSeen) {
  const std::vector<TreeCell> cells = {CellOf({{-5.5, -3.5, 0}, {4.5, 6.5, 0}})};
  EXPECT_EQ(DrawAll(cells, FrontView(), kWhole, 100),
            DrawAll(cells, FrontView(), kWhole, kNothing));
}

TEST(CellLines, AreHiddenByTheShareOfSamplesInFront) {
  const std::vector<TreeCell> cells = {CellOf({{-5.5, -3.5, -5}, {4.5, 6.5, -5}})};
  const CellLines lines(cells, FrontView(), kWhole, kPlain);
  std::vector<Hit> hits = Surface(kWhole, 4, kNothing);
  for (std::size_t i = 0; i < hits.size(); i += 4) hits[i].t = 100;
  std::vector<float> opacity(kWhole.pixel_count());
  ASSERT_TRUE(lines.Draw(kWhole, hits, 4, opacity).ok());
  EXPECT_EQ(opacity[8 * 20 + 4], 0.75f);
}

TEST(CellLines, FadeFromNearToFar) {
  const std::vector<TreeCell> cells = {CellOf({{-5.5, -30, 0}, {-5.5, 30, 0}}),
                                       CellOf({{0.5, -30, -5}, {0.5, 30, -5}}),
                                       CellOf({{4.5, -30, -10}, {4.5, 30, -10}})};
  LineStyle style = kPlain;
  style.far_opacity = 0.5f;
  const std::vector<float> opacity = DrawAll(cells, FrontView(), kWhole, kNothing, style);
  EXPECT_NEAR(opacity[4], 1.0f, 1e-6f);
  EXPECT_NEAR(opacity[10], 0.75f, 1e-6f);
  EXPECT_NEAR(opacity[14], 0.5f, 1e-6f);
}

TEST(CellLines, OfEmptyCellsAreFainterButForEdgesSharedWithFullOnes) {
  std::vector<TreeCell> cells = {CellOf({{-5.5, -30, 0}, {0.5, 30, 0}}),
                                 CellOf({{0.5, -30, 0}, {4.5, 30, 0}})};
  cells[0].triangles = 0;
  LineStyle style = kPlain;
  style.empty_opacity = 0.25f;
  const std::vector<float> opacity = DrawAll(cells, FrontView(), kWhole, kNothing, style);
  EXPECT_EQ(opacity[4], 0.25f);
  EXPECT_EQ(opacity[10], 1.0f);
  EXPECT_EQ(opacity[14], 1.0f);
}

TEST(CellLines, BehindTheEyeAreNotDrawn) {
  for (const Projection projection : {Projection::kPerspective, Projection::kOrthographic}) {
    const Camera camera = *ResolveCamera(
        {.projection = projection, .eye = Vec3d{0, 0, 100}, .target = Vec3d{}, .view_height = 20.0},
        {{-1, -1, -1}, {1, 1, 1}}, 20, 20);
    const std::vector<float> opacity =
        DrawAll({CellOf({{-5, -5, 110}, {5, 5, 120}})}, camera, kWhole, kNothing);
    EXPECT_EQ(*std::max_element(opacity.begin(), opacity.end()), 0.0f);
  }
}

std::vector<TreeCell> RandomCells(int count) {
  std::mt19937_64 random = test::RandomEngine(301);
  std::uniform_real_distribution<double> coordinate(-1, 1);
  std::vector<TreeCell> cells;
  for (int i = 0; i < count; ++i) {
    Bounds3d box = Bounds3d::Empty();
    box.Extend(Vec3d{coordinate(random), coordinate(random), coordinate(random)});
    box.Extend(Vec3d{coordinate(random), coordinate(random), coordinate(random)});
    cells.push_back(CellOf(box));
  }
  return cells;
}

// A camera within the cells, with many lines beside and behind it.
Camera InsideView(int width, int height) {
  return *ResolveCamera(
      {.eye = Vec3d{0.1, 0.2, 0.3}, .target = Vec3d{0.5, -0.2, -0.7}, .fov_deg = 80.0},
      {{-1, -1, -1}, {1, 1, 1}}, width, height);
}

TEST(CellLines, DoNotDependOnTheOrderOfCells) {
  std::vector<TreeCell> cells = RandomCells(100);
  const Camera camera = InsideView(160, 120);
  const Region whole = {0, 0, 160, 120};
  const std::vector<float> expected = DrawAll(cells, camera, whole, 0.8, {});
  EXPECT_GT(std::count_if(expected.begin(), expected.end(), [](float o) { return o > 0; }), 1000);
  std::mt19937_64 random = test::RandomEngine(302);
  std::shuffle(cells.begin(), cells.end(), random);
  cells.insert(cells.end(), cells.begin(), cells.begin() + 30);
  EXPECT_EQ(DrawAll(cells, camera, whole, 0.8, {}), expected);
}

TEST(CellLines, GiveAPixelTheSameValueInEveryRegionAndTile) {
  const std::vector<TreeCell> cells = RandomCells(100);
  const Camera camera = InsideView(160, 120);
  const Region whole = {0, 0, 160, 120};
  const std::vector<float> expected = DrawAll(cells, camera, whole, 0.8, {});
  for (const Region& region : {Region{0, 0, 160, 1}, {17, 31, 18, 32}, {5, 40, 150, 119}}) {
    const CellLines lines(cells, camera, region);
    for (const int side : {1, 13, 64}) {
      const TileGrid tiles(region, side);
      for (std::size_t t = 0; t < tiles.size(); ++t) {
        const Tile tile = tiles[t];
        std::vector<float> opacity(tile.pixel_count());
        ASSERT_TRUE(lines.Draw(tile, Surface(tile, 1, 0.8), 1, opacity).ok());
        std::size_t i = 0;
        for (int y = tile.y0; y < tile.y1; ++y) {
          for (int x = tile.x0; x < tile.x1; ++x, ++i) {
            ASSERT_EQ(opacity[i], expected[static_cast<std::size_t>(y * 160 + x)]) << x << ' ' << y;
          }
        }
      }
    }
  }
}

TEST(CellLines, AreDrawnAtAnyScale) {
  for (const double scale : {1e-30, 1e30}) {
    const Bounds3d box = {{-scale, -scale, -scale}, {scale, scale, scale}};
    const Camera camera = *ResolveCamera({}, box, 160, 120);
    const std::vector<float> opacity =
        DrawAll({CellOf(box)}, camera, {0, 0, 160, 120}, kNothing, {});
    EXPECT_GT(std::count_if(opacity.begin(), opacity.end(), [](float o) { return o > 0.2f; }), 500);
  }
}

}  // namespace
}  // namespace kdray::core
