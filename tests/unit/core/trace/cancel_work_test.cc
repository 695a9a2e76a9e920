// SPDX-License-Identifier: Apache-2.0
// What works on meshes, trees and pictures ends soon after its cancellation: tokens are cancelled
// while the call works.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <memory>
#include <numeric>
#include <random>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "core/accel/tree.h"
#include "core/base/polled_sort.h"
#include "core/geometry/mesh_health.h"
#include "core/geometry/triangle_mesh.h"
#include "core/io/png_writer.h"
#include "core/render/cell_lines.h"
#include "core/render/picture.h"
#include "core/render/renderer.h"
#include "core/scene/scene.h"
#include "tests/support/cancel_probe.h"
#include "tests/support/scenes.h"
#include "tests/support/shapes.h"

namespace kdray {
namespace {

using core::BuildKind;
using core::CancelPoll;
using core::CancelToken;
using core::ErrorCode;
using core::MeshData;
using core::Scene;
using core::Status;
using core::TriangleMesh;
using core::Vec3d;
using std::chrono::milliseconds;
using test::CancelDuring;
using test::CancelledCall;
using test::ExpectPrompt;
using test::StatusOf;

std::shared_ptr<const TriangleMesh> Mesh(const MeshData& data) {
  return std::make_shared<const TriangleMesh>(*TriangleMesh::Create(data));
}

// Triangles between 256 corners that lie within some units in the last place of a line: whether one
// is degenerate takes exact arithmetic.
MeshData Slivers(std::size_t count) {
  MeshData mesh;
  std::mt19937 random(1);
  for (int i = 0; i < 256; ++i) {
    const double x = 1.0 + i * 1e-5;
    double y = 0.1 * x;
    for (auto steps = random() % 4; steps > 0; --steps) y = std::nextafter(y, 9.0);
    mesh.vertices.push_back({x, y, 0.3 * x});
  }
  for (std::size_t i = 0; i < count; ++i) {
    const auto a = static_cast<std::uint32_t>(random() % 256);
    mesh.triangles.push_back({a, (a + 1 + static_cast<std::uint32_t>(random() % 100)) % 256,
                              (a + 120 + static_cast<std::uint32_t>(random() % 100)) % 256});
  }
  return mesh;
}

TEST(CancelledMesh, CreateEndsAmongTrianglesThatTakeExactArithmetic) {
  const MeshData data = Slivers((std::size_t{1} << 20) * test::CancelScale());
  for (const milliseconds after : {milliseconds(5), milliseconds(40)}) {
    ExpectPrompt(CancelDuring(after,
                              [&](const CancelToken& token) {
                                // Again, should one mesh take less than that.
                                for (;;) {
                                  const auto mesh = TriangleMesh::Create(data, token);
                                  if (!mesh.ok()) return StatusOf(mesh);
                                }
                              }),
                 "Create after " + std::to_string(after.count()) + " ms");
  }
}

TEST(CancelledMesh, CheckHealthEndsAlsoWhereAllVerticesAreInOnePlaceOrOnOneEdge) {
  const std::size_t count = (std::size_t{1} << 20) * test::CancelScale();
  MeshData fan;  // all triangles at one edge
  fan.vertices = {{0, 0, 0}, {1, 0, 0}};
  MeshData soup;  // each triangle in the same place, with corners of its own
  for (std::size_t i = 0; i < count; ++i) {
    const auto corner = static_cast<std::uint32_t>(fan.vertices.size());
    fan.vertices.push_back({0, 1, static_cast<double>(i)});
    fan.triangles.push_back({0, 1, corner});
    const auto first = static_cast<std::uint32_t>(soup.vertices.size());
    for (const Vec3d& p : {Vec3d{0, 0, 0}, Vec3d{1, 0, 0}, Vec3d{0, 1, 0}}) {
      soup.vertices.push_back(p);
    }
    soup.triangles.push_back({first, first + 1, first + 2});
  }
  for (const MeshData* data : {&fan, &soup}) {
    const auto mesh = Mesh(*data);
    for (const milliseconds after : {milliseconds(5), milliseconds(60), milliseconds(150)}) {
      ExpectPrompt(CancelDuring(after,
                                [&](const CancelToken& token) {
                                  for (;;) {
                                    const auto health = CheckHealth(*mesh, *data, token);
                                    if (!health.ok()) return StatusOf(health);
                                  }
                                }),
                   std::string(data == &fan ? "the fan" : "the soup") + " after " +
                       std::to_string(after.count()) + " ms");
    }
  }
}

TEST(CancelledBuild, EndsAtAnyMoment) {
  const auto soup = Mesh(test::Soup(300'000, 0.05, 4));
  for (const BuildKind kind : core::kAllBuildKinds) {
    if (kind == BuildKind::kBox) continue;  // below
    for (const milliseconds after : {milliseconds(5), milliseconds(60), milliseconds(150)}) {
      ExpectPrompt(CancelDuring(after,
                                [&](const CancelToken& token) {
                                  // Again, should one build take less than that.
                                  for (;;) {
                                    const auto tree = BuildTree(*soup, kind, {token});
                                    if (!tree.ok()) return StatusOf(tree);
                                  }
                                }),
                   std::string(Name(kind)) + " after " + std::to_string(after.count()) + " ms");
    }
  }
}

TEST(CancelledBuild, EndsInTheFirstStepsOfALargeMesh) {
  const auto mesh = Mesh(test::Grid(500 * static_cast<int>(test::CancelScale()), 2, 0));
  for (const BuildKind kind : core::kAllBuildKinds) {
    for (const milliseconds after : {milliseconds(10), milliseconds(60)}) {
      ExpectPrompt(CancelDuring(after,
                                [&](const CancelToken& token) {
                                  for (;;) {
                                    const auto tree = BuildTree(*mesh, kind, {token});
                                    if (!tree.ok()) return StatusOf(tree);
                                  }
                                }),
                   std::string(Name(kind)) + " after " + std::to_string(after.count()) + " ms");
    }
  }
}

TEST(CancelledBuild, IsFullOrNothingWheneverItIsCancelled) {
  // Also meshes that are built in one piece, without a top.
  for (const int triangles : {100, 3'000, 30'000}) {
    const auto mesh = Mesh(test::Soup(triangles, 0.05, 5));
    for (const BuildKind kind : core::kAllBuildKinds) {
      const core::Tree expected = *BuildTree(*mesh, kind);
      bool completed = false;
      for (std::uint64_t look = 1; !completed; look += 1 + look / 2) {
        const auto tree = BuildTree(*mesh, kind, {test::CancelledAtLook(look)});
        completed = tree.ok();
        if (completed) {
          EXPECT_EQ(tree->stats, expected.stats) << Name(kind);
          EXPECT_EQ(tree->wide.nodes.size(), expected.wide.nodes.size()) << Name(kind);
          EXPECT_TRUE(tree->wide.Validate(mesh->triangle_count()).ok()) << Name(kind);
        } else {
          ASSERT_EQ(tree.error().code, ErrorCode::kCancelled);
        }
      }
    }
  }
}

TEST(CancelledCells, EndWhileTheTreeIsBuiltAgain) {
  const Scene scene =
      test::MakeScene(test::Soup(std::size_t{60'000} * test::CancelScale(), 0.03, 6));
  ExpectPrompt(
      CancelDuring(milliseconds(20),
                   [&](const CancelToken& token) { return StatusOf(scene.Cells(3, 1000, token)); }),
      "Cells");
  EXPECT_TRUE(scene.Cells(3, 1000).ok()) << "the next call fails";
}

TEST(CancelledPicture, EncodingEndsInALargePicture) {
  // Noise, which compresses worst.
  constexpr int kWidth = 8192, kHeight = 4096;
  std::vector<std::uint8_t> pixels(std::size_t{3} * kWidth * kHeight);
  std::mt19937_64 random(1);
  for (std::size_t i = 0; i + 8 <= pixels.size(); i += 8) {
    const std::uint64_t eight = random();
    std::copy_n(reinterpret_cast<const std::uint8_t*>(&eight), 8, &pixels[i]);
  }
  for (const milliseconds after : {milliseconds(5), milliseconds(100)}) {
    ExpectPrompt(CancelDuring(after,
                              [&](const CancelToken& token) {
                                return StatusOf(core::EncodePng(pixels, kWidth, kHeight, 3, token));
                              }),
                 "EncodePng");
  }
}

TEST(CancelledPicture, MakingOneEnds) {
  core::RenderedImage image;
  image.mode = core::RenderMode::kShaded;
  const core::Region region = {0, 0, 8192, 4096};
  image.values = core::Film<float>(region, 4);
  image.background.transparent = true;
  ExpectPrompt(CancelDuring(milliseconds(30),
                            [&](const CancelToken& token) {
                              return StatusOf(core::MakePicture(image, token));
                            }),
               "MakePicture");
}

TEST(CancelledPicture, LinesOfManyCellsInOneTileEnd) {
  // Every cell's edges go through the whole picture, which is one tile.
  std::vector<core::TreeCell> cells;
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> uniform(0, 1);
  for (int i = 0; i < 16384; ++i) {
    core::TreeCell cell;
    cell.bounds = {{-1 - uniform(random), -1 - uniform(random), -1 - uniform(random)},
                   {1 + uniform(random), 1 + uniform(random), 1 + uniform(random)}};
    cell.triangles = 1;
    cells.push_back(cell);
  }
  const core::Bounds3d bounds = {{-2, -2, -2}, {2, 2, 2}};
  const core::Camera camera = *core::ResolveCamera({}, bounds, 64, 64);
  const core::Region region = {0, 0, 64, 64};
  std::vector<core::Hit> hits(region.pixel_count() * 16);
  ExpectPrompt(CancelDuring(milliseconds(100),
                            [&](const CancelToken& token) -> Status {
                              const core::CellLines lines(cells, camera, region, {}, token);
                              std::vector<float> opacity(region.pixel_count());
                              return lines.Draw(region, hits, 16, opacity, token);
                            }),
               "CellLines");
}

TEST(CancelledPicture, LinesThatWereCutShortAreNotDrawn) {
  const std::vector<core::TreeCell> cells = {{.bounds = {{-1, -1, -1}, {1, 1, 1}}, .triangles = 1}};
  const core::Camera camera = *core::ResolveCamera({}, cells[0].bounds, 64, 64);
  const core::Region region = {0, 0, 64, 64};
  const CancelToken token = CancelToken::Cancellable();
  token.Cancel();
  const core::CellLines lines(cells, camera, region, {}, token);
  std::vector<float> opacity(region.pixel_count());
  const std::vector<core::Hit> hits(region.pixel_count());
  const Status status = lines.Draw(region, hits, 1, opacity, token);
  ASSERT_FALSE(status.ok());
  EXPECT_EQ(status.error().code, core::ErrorCode::kCancelled);
}

TEST(CancelledRender, EndsBeforeTheFirstRayOfALargeImage) {
  const Scene scene = test::MakeScene(test::Cube({0, 0, 0}, 1));
  core::RenderSpec spec;
  spec.width = 16384;
  spec.height = 4096;
  spec.samples = 8192;
  ExpectPrompt(CancelDuring(milliseconds(20),
                            [&](const CancelToken& token) {
                              return StatusOf(core::Render(scene, spec, token));
                            }),
               "Render");
  spec.samples = 1;
  spec.budget = milliseconds(100'000);
  ExpectPrompt(CancelDuring(milliseconds(400),
                            [&](const CancelToken& token) {
                              return StatusOf(core::Render(scene, spec, token));
                            }),
               "Render within a budget");
}

TEST(PolledSort, OrdersAsTheStandardLibraryDoes) {
  std::mt19937 random(1);
  for (const std::size_t size : {0u, 1u, 15u, 16u, 17u, 100u, 1000u, 70'000u}) {
    std::vector<int> values(size);
    for (int& value : values) value = static_cast<int>(random() % (size + 1));
    std::vector<int> expected = values;
    std::sort(expected.begin(), expected.end());
    for (const std::uint64_t work : {std::uint64_t{1}, std::uint64_t{4096}}) {
      for (const std::size_t keep : {std::size_t{1}, std::size_t{40}, size}) {
        std::vector<int> sorted = values;
        CancelPoll never{CancelToken()};
        ASSERT_TRUE(core::PolledPartialSort(std::span(sorted), keep, work, &never, std::less<>()));
        for (std::size_t i = 0; i < std::min(size, keep); ++i) {
          ASSERT_EQ(sorted[i], expected[i]) << size << " values, " << keep << " kept, place " << i;
        }
      }
    }
    if (size == 0) continue;
    for (const std::size_t n : {std::size_t{0}, size / 3, size / 2, size - 1}) {
      std::vector<int> some = values;
      CancelPoll never{CancelToken()};
      ASSERT_TRUE(core::PolledNthElement(std::span(some), n, 1, &never));
      ASSERT_EQ(some[n], expected[n]) << size << " values, place " << n;
      for (std::size_t i = 0; i < size; ++i)
        ASSERT_TRUE(i < n ? some[i] <= some[n] : some[i] >= some[n]);
    }
  }
}

TEST(PolledSort, EndsWhenItIsCancelled) {
  std::vector<std::uint32_t> values(6'000'000);
  std::mt19937 random(1);
  for (std::uint32_t& value : values) value = static_cast<std::uint32_t>(random());
  ExpectPrompt(CancelDuring(milliseconds(100),
                            [&](const CancelToken& token) {
                              CancelPoll poll(token);
                              std::vector<std::uint32_t> sorted = values;
                              core::PolledSort(std::span(sorted), 8, &poll);
                              return poll.ToStatus();
                            }),
               "PolledSort");
}

}  // namespace
}  // namespace kdray
