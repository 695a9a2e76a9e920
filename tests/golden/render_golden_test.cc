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
