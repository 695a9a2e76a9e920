// SPDX-License-Identifier: Apache-2.0
// Pictures of generated meshes, kept and looked at. To make one anew after a wanted change, run
// with KDRAY_UPDATE_GOLDEN=1, look at it, and commit it apart with the reason.
#include <gtest/gtest.h>

#include <cstddef>
#include <stdexcept>
#include <vector>

#include "core/io/png_writer.h"
#include "core/render/picture.h"
#include "core/render/renderer.h"
#include "tests/support/image.h"
#include "tests/support/scenes.h"
#include "tests/support/shapes.h"

namespace kdray {
namespace {

using test::MatchesGolden;

std::vector<std::byte> RenderPng(const core::MeshData& mesh, const core::RenderSpec& spec) {
  const core::Result<core::RenderedImage> image = core::Render(test::MakeScene(mesh), spec);
  if (!image.ok()) throw std::runtime_error(image.error().message);
  const core::Picture picture = core::MakePicture(*image);
  return *core::EncodePng(picture.pixels, picture.width, picture.height, picture.channels);
}

core::RenderSpec Spec(core::RenderMode mode, int samples) {
  return {.width = 320, .height = 240, .mode = mode, .samples = samples};
}

core::MeshData Bumpy() { return test::BumpySphere({0, 0, 0}, 1, 60, 90, 0.25); }

/// A sphere and a cube that stand on a floor.
core::MeshData StillLife() {
  core::MeshData floor = test::Grid(8, 2, 0);
  for (core::Vec3d& p : floor.vertices) p = {8 * p.x - 4, 8 * p.y - 4, 0};
  return test::Join(test::Join(floor, test::IcoSphere({-0.9, 0, 1}, 1, 4)),
                    test::Cube({1.4, 0.4, 0.7}, 0.7));
}
core::RenderSpec StillLifeSpec(core::RenderMode mode, int samples) {
  core::RenderSpec spec = Spec(mode, samples);
  spec.camera = {.eye = core::Vec3d{1.5, -6, 3.5},
                 .target = core::Vec3d{0.2, 0, 0.6},
                 .up = core::Vec3d{0, 0, 1},
                 .fov_deg = 45.0};
  return spec;
}

TEST(Golden, ShadowsOfASunAndALamp) {
  core::RenderSpec spec = StillLifeSpec(core::RenderMode::kShaded, 64);
  spec.lights = {{.kind = core::LightKind::kDirectional, .vector = {1, 1.5, -2}, .intensity = 0.7},
                 {.kind = core::LightKind::kPoint,
                  .vector = {3, -2, 3},
                  .intensity = 0.1,
                  .color = {1, 0.6f, 0.3f}}};
  spec.shadows = true;
  EXPECT_TRUE(MatchesGolden("shadows_still_life", RenderPng(StillLife(), spec)));
}

TEST(Golden, AmbientOcclusionWhereThingsStand) {
  EXPECT_TRUE(MatchesGolden(
      "occlusion_still_life",
      RenderPng(StillLife(), StillLifeSpec(core::RenderMode::kAmbientOcclusion, 64))));
}

TEST(Golden, PanoramaFromBetweenTheThings) {
  core::RenderSpec spec = Spec(core::RenderMode::kShaded, 16);
  spec.height = 160;
  spec.camera = {.projection = core::Projection::kSpherical,
                 .eye = core::Vec3d{0.4, -0.6, 0.9},
                 .target = core::Vec3d{0.4, 1, 0.9},
                 .up = core::Vec3d{0, 0, 1}};
  EXPECT_TRUE(MatchesGolden("panorama_still_life", RenderPng(StillLife(), spec)));
}

TEST(Golden, ShadedSphere) {
  EXPECT_TRUE(MatchesGolden("shaded_sphere", RenderPng(test::IcoSphere({0, 0, 0}, 1, 4),
                                                       Spec(core::RenderMode::kShaded, 16))));
}

TEST(Golden, ShadedBumpySphereBeforeATransparentBackground) {
  core::RenderSpec spec = Spec(core::RenderMode::kShaded, 16);
  spec.background = core::Background{.transparent = true};
  spec.color = {0.35f, 0.65f, 0.55f};
  EXPECT_TRUE(MatchesGolden("shaded_bumpy_transparent", RenderPng(Bumpy(), spec)));
}

TEST(Golden, CellsOverABumpySphere) {
  core::RenderSpec spec = Spec(core::RenderMode::kShaded, 16);
  spec.cells_depth = 8;
  EXPECT_TRUE(MatchesGolden("cells_bumpy", RenderPng(Bumpy(), spec)));
}

TEST(Golden, CellsFromWithinAmongTheTriangles) {
  core::RenderSpec spec = Spec(core::RenderMode::kTriangle, 1);
  spec.camera = {
      .eye = core::Vec3d{0.5, 0.5, 0.5}, .target = core::Vec3d{1, 0.8, 0.1}, .fov_deg = 90.0};
  spec.cells_depth = 6;
  EXPECT_TRUE(MatchesGolden("cells_soup_inside", RenderPng(test::Soup(500, 0.1, 5), spec)));
}

TEST(Golden, NormalsOfACube) {
  EXPECT_TRUE(MatchesGolden(
      "normal_cube", RenderPng(test::Cube({0, 0, 0}, 1), Spec(core::RenderMode::kNormal, 16))));
}

TEST(Golden, DepthOfABumpySphereInOrthographicProjection) {
  core::RenderSpec spec = Spec(core::RenderMode::kDepth, 1);
  spec.camera.projection = core::Projection::kOrthographic;
  EXPECT_TRUE(MatchesGolden("depth_bumpy_orthographic", RenderPng(Bumpy(), spec)));
}

TEST(Golden, TrianglesOfASphereWithZUp) {
  core::RenderSpec spec = Spec(core::RenderMode::kTriangle, 1);
  spec.camera.up = core::Vec3d{0, 0, 1};
  EXPECT_TRUE(
      MatchesGolden("triangle_sphere_z_up", RenderPng(test::UvSphere({0, 0, 0}, 1, 12, 24), spec)));
}

TEST(Golden, ShadedSpiral) {
  EXPECT_TRUE(MatchesGolden("shaded_spiral",
                            RenderPng(test::Spiral(4000, 8), Spec(core::RenderMode::kShaded, 16))));
}

}  // namespace
}  // namespace kdray
