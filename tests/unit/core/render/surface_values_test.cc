// SPDX-License-Identifier: Apache-2.0
// Normals and colours of the file in shaded images.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <stdexcept>

#include "core/render/renderer.h"
#include "tests/support/scenes.h"
#include "tests/support/shapes.h"

namespace kdray::core {
namespace {

using ::kdray::test::MakeScene;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

const Scene& Sphere() {
  static const Scene scene = MakeScene(test::IcoSphere({0, 0, 0}, 1, 3));
  return scene;
}

RenderSpec FromAbove() {
  RenderSpec spec = {.width = 101, .height = 101};
  spec.camera = {.projection = Projection::kOrthographic,
                 .eye = Vec3d{0, 0, 10},
                 .target = Vec3d{},
                 .up = Vec3d{0, 1, 0},
                 .view_height = 2.02};
  spec.color = {1, 1, 1};
  return spec;
}

RenderedImage RenderOk(const RenderSpec& spec) {
  Result<RenderedImage> image = Render(Sphere(), spec);
  if (!image.ok()) throw std::runtime_error(image.error().message);
  return *std::move(image);
}

std::span<const float> Pixel(const RenderedImage& image, int x, int y) {
  return std::get<Film<float>>(image.values)(x, y);
}

bool SameBytes(const RenderedImage& a, const RenderedImage& b) {
  const auto x = std::get<Film<float>>(a.values).values();
  const auto y = std::get<Film<float>>(b.values).values();
  return x.size() == y.size() && std::memcmp(x.data(), y.data(), x.size_bytes()) == 0;
}

// Of the sphere: the corners' own, interpolated. `turned` is the sign that the file gives them.
SurfaceValue SphereNormals(double turned) {
  return [turned](PrimitiveId id, double u, double v) {
    const TriangleMesh& mesh = *Sphere().mesh;
    const Vec3d a = mesh.frame().ToWorld(mesh.LocalCorner(id, 0));
    const Vec3d b = mesh.frame().ToWorld(mesh.LocalCorner(id, 1));
    const Vec3d c = mesh.frame().ToWorld(mesh.LocalCorner(id, 2));
    return Normalized(a * (1 - u - v) + b * u + c * v) * turned;
  };
}

// The largest difference from Lambert on a true sphere, away from its outline.
double WorstError(const RenderedImage& image, const Vec3d& to_light) {
  double worst = 0;
  for (int j = 0; j < 101; ++j) {
    for (int i = 0; i < 101; ++i) {
      const double x = (i - 50) * 0.02;
      const double y = (50 - j) * 0.02;
      if (x * x + y * y > 0.9) continue;
      const Vec3d normal = {x, y, std::sqrt(1 - x * x - y * y)};
      // Where a facet is turned away from the light, it is dark whatever its normals are.
      const double cosine = Dot(normal, to_light);
      if (std::fabs(cosine) < 0.15) continue;
      worst = std::max(
          worst, std::fabs(static_cast<double>(Pixel(image, i, j)[0]) - std::max(cosine, 0.0)));
    }
  }
  return worst;
}

TEST(SurfaceValues, SmoothNormalsShadeASphereWithoutFacets) {
  const Vec3d to_light = Normalized(Vec3d{3, 1, 2});
  for (const double turned : {1.0, -1.0}) {
    RenderSpec spec = FromAbove();
    // Under a headlight.
    EXPECT_GT(WorstError(RenderOk(spec), {0, 0, 1}), 0.02);
    spec.smooth_normals = SphereNormals(turned);
    EXPECT_LT(WorstError(RenderOk(spec), {0, 0, 1}), 0.015);
    spec.lights = {{.vector = -to_light}};
    EXPECT_LT(WorstError(RenderOk(spec), to_light), 0.015);
    spec.smooth_normals = nullptr;
    EXPECT_GT(WorstError(RenderOk(spec), to_light), 0.02);
  }
}

TEST(SurfaceValues, TheTrianglesNormalDecidesWhichSideIsLit) {
  // All normals point at the light, but half of the sphere is turned away from it.
  RenderSpec spec = FromAbove();
  spec.lights = {{.vector = {-1, 0, 0}}};
  spec.smooth_normals = [](PrimitiveId, double, double) { return Vec3d{1, 0, 0}; };
  const RenderedImage image = RenderOk(spec);
  EXPECT_EQ(Pixel(image, 75, 50)[0], 1.0f);
  EXPECT_EQ(Pixel(image, 25, 50)[0], 0.0f);
}

TEST(SurfaceValues, WhatTheFileDoesNotHaveIsTheTrianglesOwn) {
  RenderSpec spec = FromAbove();
  spec.color = {0.2f, 0.5f, 0.9f};
  for (const bool with_light : {false, true}) {
    if (with_light) spec.lights = {{.vector = {1, 1, -2}}};
    spec.smooth_normals = nullptr;
    spec.file_colors = nullptr;
    const RenderedImage plain = RenderOk(spec);
    spec.smooth_normals = spec.file_colors = [](PrimitiveId, double, double) {
      return Vec3d{kNan, kNan, kNan};
    };
    const RenderedImage without = RenderOk(spec);
    if (with_light) {
      EXPECT_TRUE(SameBytes(plain, without));
    } else {
      for (int i = 0; i < 101; ++i)
        ASSERT_NEAR(Pixel(plain, i, 50)[1], Pixel(without, i, 50)[1], 1e-6);
    }
  }
}

TEST(SurfaceValues, ColoursOfTheFileReplaceTheColour) {
  RenderSpec spec = FromAbove();
  spec.color = {1, 0, 1};
  spec.file_colors = [](PrimitiveId id, double u, double) {
    return id % 2 == 0 ? Vec3d{u, 1, 0} : Vec3d{kNan, kNan, kNan};
  };
  const RenderedImage image = RenderOk(spec);
  int own = 0;
  int replaced = 0;
  for (int j = 30; j < 70; ++j) {
    for (int i = 30; i < 70; ++i) {
      const std::span<const float> pixel = Pixel(image, i, j);
      if (pixel[1] == 0) {
        ASSERT_EQ(pixel[0], pixel[2]);
        ++own;
      } else {
        ASSERT_EQ(pixel[2], 0.0f);
        ASSERT_LE(pixel[0], pixel[1]);
        ++replaced;
      }
    }
  }
  EXPECT_GT(own, 300);
  EXPECT_GT(replaced, 300);
}

}  // namespace
}  // namespace kdray::core
