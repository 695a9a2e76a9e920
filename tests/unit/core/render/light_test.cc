// SPDX-License-Identifier: Apache-2.0
// Shading by lights and shadows, against closed forms.
#include "core/render/light.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstring>
#include <numbers>
#include <stdexcept>
#include <vector>

#include "core/render/renderer.h"
#include "core/render/shading.h"
#include "tests/support/scenes.h"
#include "tests/support/shapes.h"

namespace kdray::core {
namespace {

using ::kdray::test::MakeScene;

constexpr Rgb kWhite = {1, 1, 1};

RenderedImage RenderOk(const Scene& scene, const RenderSpec& spec) {
  Result<RenderedImage> image = Render(scene, spec);
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

Light Sun(const Vec3d& travels) { return {.kind = LightKind::kDirectional, .vector = travels}; }
Light Lamp(const Vec3d& place) { return {.kind = LightKind::kPoint, .vector = place}; }

// Looks at the origin from +z, `view_height` from top to bottom; white.
RenderSpec FromAbove(int side, double view_height) {
  RenderSpec spec = {.width = side, .height = side};
  spec.camera = {.projection = Projection::kOrthographic,
                 .eye = Vec3d{0, 0, 10},
                 .target = Vec3d{},
                 .up = Vec3d{0, 1, 0},
                 .view_height = view_height};
  spec.color = kWhite;
  spec.background = Background{.transparent = true};
  return spec;
}

// Where FromAbove's pixel centre lies.
struct Place {
  double x, y;
};
Place PlaceOf(const RenderSpec& spec, int i, int j) {
  const double size = *spec.camera.view_height / spec.height;
  return {(i + 0.5 - 0.5 * spec.width) * size, (0.5 * spec.height - j - 0.5) * size};
}

// Two triangles: [-half, half]^2 about (x, y) at height z.
void AddSquare(double x, double y, double z, double half, MeshData* mesh) {
  const auto first = static_cast<std::uint32_t>(mesh->vertices.size());
  for (const auto& [dx, dy] : {std::pair{-1, -1}, {1, -1}, {1, 1}, {-1, 1}}) {
    mesh->vertices.push_back({x + dx * half, y + dy * half, z});
  }
  mesh->triangles.push_back({first, first + 1, first + 2});
  mesh->triangles.push_back({first, first + 2, first + 3});
}

TEST(Light, ASphereUnderADirectionalLightFollowsLambert) {
  const Scene scene = MakeScene(test::IcoSphere({0, 0, 0}, 1, 5));
  RenderSpec spec = FromAbove(101, 2.02);
  Light light = Sun({-3, -1, -2});
  light.intensity = 0.5;
  light.color = {1, 0.5f, 0};
  spec.lights = {light};
  const RenderedImage image = RenderOk(scene, spec);
  const Vec3d to_light = Normalized(Vec3d{3, 1, 2});
  const double green = static_cast<double>(SrgbToLinear(0.5f));
  int lit = 0;
  int dark = 0;
  for (int j = 0; j < 101; ++j) {
    for (int i = 0; i < 101; ++i) {
      const auto [x, y] = PlaceOf(spec, i, j);
      const double r2 = x * x + y * y;
      if (r2 > 0.96) continue;
      const double cosine = std::max(Dot(Vec3d{x, y, std::sqrt(1 - r2)}, to_light), 0.0);
      const std::span<const float> pixel = Pixel(image, i, j);
      // The normal of a flat triangle leans from the sphere's by up to its radius, some 0.03.
      ASSERT_NEAR(pixel[0], 0.5 * cosine, 0.5 * 0.04) << i << ' ' << j;
      ASSERT_NEAR(pixel[1], green * static_cast<double>(pixel[0]), 1e-6);
      ASSERT_EQ(pixel[2], 0.0f);
      ++(pixel[0] > 0 ? lit : dark);
    }
  }
  EXPECT_GT(lit, 4000);
  EXPECT_GT(dark, 500);
}

TEST(Light, LightsAddUp) {
  const Scene scene = MakeScene(test::IcoSphere({0, 0, 0}, 1, 3));
  RenderSpec spec = FromAbove(31, 2.2);
  const auto render = [&](std::vector<Light> lights) {
    spec.lights = std::move(lights);
    return RenderOk(scene, spec);
  };
  const Light a = Sun({1, 0, -1});
  const Light b = Lamp({-2, 1, 3});
  const RenderedImage both = render({a, b});
  const RenderedImage first = render({a});
  const RenderedImage second = render({b});
  const RenderedImage none = render({});
  for (int y = 0; y < 31; ++y) {
    for (int x = 0; x < 31; ++x) {
      ASSERT_NEAR(Pixel(both, x, y)[0], Pixel(first, x, y)[0] + Pixel(second, x, y)[0], 1e-6f);
      ASSERT_EQ(Pixel(none, x, y)[0], 0.0f);
      ASSERT_EQ(Pixel(none, x, y)[3], Pixel(first, x, y)[3]);
    }
  }
}

TEST(Light, APointLightFallsOffWithTheSquareOfTheDistance) {
  MeshData plane;
  AddSquare(0, 0, 0, 1, &plane);
  const Scene scene = MakeScene(plane);
  RenderSpec spec = FromAbove(21, 2);
  const double diagonal = std::sqrt(8.0);
  for (const double height : {0.5, 1.0, diagonal, 5.0, 1e6}) {
    spec.lights = {Lamp({0.2, -0.3, height})};
    const RenderedImage image = RenderOk(scene, spec);
    for (int j = 0; j < 21; ++j) {
      for (int i = 0; i < 21; ++i) {
        const auto [x, y] = PlaceOf(spec, i, j);
        const double distance =
            std::sqrt(std::pow(x - 0.2, 2) + std::pow(y + 0.3, 2) + height * height);
        const double expected = std::pow(diagonal / distance, 2) * height / distance;
        ASSERT_NEAR(Pixel(image, i, j)[0], expected, 1e-6 * expected) << height;
      }
    }
  }
}

TEST(Light, APointLightDoesNotDependOnTheScaleOfTheScene) {
  for (const double scale : {1e-30, 1e-3, 1.0, 1e30}) {
    MeshData plane;
    AddSquare(0, 0, 0, scale, &plane);
    const Scene scene = MakeScene(plane);
    RenderSpec spec = {.width = 3, .height = 3};
    spec.camera = {.eye = Vec3d{0, 0, 2 * scale}, .target = Vec3d{}, .fov_deg = 40.0};
    spec.color = kWhite;
    spec.shadows = true;
    spec.lights = {Lamp(Vec3d{0, 0, std::sqrt(8.0)} * scale)};
    EXPECT_NEAR(Pixel(RenderOk(scene, spec), 1, 1)[0], 1, 1e-6) << scale;
  }
}

TEST(Light, LightsOnlyTheSideOnWhichItStands) {
  MeshData plane;
  AddSquare(0, 0, 0, 1, &plane);
  RenderSpec spec = FromAbove(1, 0.1);
  for (const bool reversed : {false, true}) {
    if (reversed) {
      for (TriangleIndices& t : plane.triangles) std::swap(t[1], t[2]);
    }
    const Scene scene = MakeScene(plane);
    spec.lights = {Sun({0, 0, -2})};
    EXPECT_EQ(Pixel(RenderOk(scene, spec), 0, 0)[0], 1.0f);
    spec.lights = {Sun({0, 0, 2})};
    EXPECT_EQ(Pixel(RenderOk(scene, spec), 0, 0)[0], 0.0f);
    spec.lights = {Lamp({0, 0, -1})};
    EXPECT_EQ(Pixel(RenderOk(scene, spec), 0, 0)[0], 0.0f);
    spec.lights = {Lamp({0, 0, 0})};  // on the surface
    EXPECT_TRUE(std::isfinite(Pixel(RenderOk(scene, spec), 0, 0)[0]));
  }
}

TEST(Light, ASquareShadesAPlaneUpToItsEdge) {
  MeshData mesh;
  AddSquare(0, 0, 0, 4, &mesh);
  AddSquare(0, 0, 1, 0.5, &mesh);
  const Scene scene = MakeScene(mesh);
  for (const Precision precision : kAllPrecisions) {
    // Moved sideways by its height; enlarged about the middle, twice as large.
    struct Case {
      Light light;
      double x0, x1, y0, y1;
    };
    for (const Case& c :
         {Case{Sun({1, 0, -1}), 0.5, 1.5, -0.5, 0.5}, Case{Lamp({0, 0, 2}), -1, 1, -1, 1}}) {
      RenderSpec spec = FromAbove(160, 4);
      spec.precision = precision;
      spec.shadows = true;
      spec.lights = {c.light};
      const RenderedImage image = RenderOk(scene, spec);
      spec.shadows = false;
      const RenderedImage bright = RenderOk(scene, spec);
      int hidden = 0;
      for (int j = 0; j < 160; ++j) {
        for (int i = 0; i < 160; ++i) {
          const auto [x, y] = PlaceOf(spec, i, j);
          const bool on_square = std::fabs(x) < 0.5 && std::fabs(y) < 0.5;
          const bool expected = !on_square && x > c.x0 && x < c.x1 && y > c.y0 && y < c.y1;
          ASSERT_EQ(Pixel(image, i, j)[0], expected ? 0.0f : Pixel(bright, i, j)[0])
              << x << ' ' << y;
          hidden += expected ? 1 : 0;
        }
      }
      EXPECT_GT(hidden, 1500);
    }
  }
}

TEST(Light, AConvexMeshDoesNotShadeItself) {
  for (const double scale : {1e-8, 1.0, 1e8}) {
    for (const double offset : {0.0, 100.0}) {
      const Vec3d centre = Vec3d{1, -2, 3} * (scale * offset);
      const Scene scene = MakeScene(test::IcoSphere(centre, scale, 4));
      for (const Precision precision :
           {Precision::kWatertight, Precision::kDouble, Precision::kExact}) {
        RenderSpec spec = {.width = 64, .height = 64};
        spec.precision = precision;
        spec.lights = {Sun({-1, -2, 0.3}), Lamp(centre + Vec3d{3, 1, 2} * scale)};
        const RenderedImage without = RenderOk(scene, spec);
        spec.shadows = true;
        // Facets inscribed in a sphere that is far from 0 are not quite convex.
        if (offset == 0) {
          EXPECT_TRUE(SameBytes(without, RenderOk(scene, spec))) << scale;
        } else {
          const RenderedImage with = RenderOk(scene, spec);
          int differ = 0;
          for (int y = 0; y < 64; ++y) {
            for (int x = 0; x < 64; ++x) {
              differ += Pixel(with, x, y)[0] != Pixel(without, x, y)[0] ? 1 : 0;
            }
          }
          EXPECT_LT(differ, 5) << scale;
        }
      }
    }
  }
}

TEST(Light, OnlyWhatIsNamedIsComputed) {
  const Scene scene = MakeScene(test::BumpySphere({0, 0, 0}, 1, 20, 30, 0.3));
  RenderSpec spec = {.width = 40, .height = 30};
  for (const RenderMode mode : {RenderMode::kDepth, RenderMode::kTriangle}) {
    spec.mode = mode;
    const RenderCounts counts = RenderOk(scene, spec).counts;
    EXPECT_EQ(counts.camera_rays, 40u * 30u);
    EXPECT_EQ(counts.shadow_rays, 0u);
    EXPECT_EQ(counts.occlusion_rays, 0u);
    EXPECT_EQ(counts.normals, 0u);
  }
  spec.mode = RenderMode::kShaded;
  spec.lights = {Sun({0, -1, -1}), Lamp({0, 9, 9})};
  spec.samples = 4;
  RenderCounts counts = RenderOk(scene, spec).counts;
  EXPECT_EQ(counts.camera_rays, 4u * 40u * 30u);
  EXPECT_EQ(counts.shadow_rays, 0u);
  EXPECT_GT(counts.normals, 0u);
  EXPECT_LT(counts.normals, counts.camera_rays / 2);  // few per triangle
  spec.shadows = true;
  counts = RenderOk(scene, spec).counts;
  EXPECT_GT(counts.shadow_rays, 0u);
  EXPECT_LT(counts.shadow_rays, 2 * counts.camera_rays);
  EXPECT_EQ(counts.occlusion_rays, 0u);
}

TEST(Light, TheHeadlightCastsNoShadowThatIsSeen) {
  const Scene scene = MakeScene(test::BumpySphere({0, 0, 0}, 1, 20, 30, 0.3));
  RenderSpec spec = {.width = 40, .height = 30};
  const RenderedImage without = RenderOk(scene, spec);
  spec.shadows = true;
  const RenderedImage with = RenderOk(scene, spec);
  EXPECT_TRUE(SameBytes(without, with));
  EXPECT_EQ(with.counts.shadow_rays, 0u);
}

TEST(Light, ValuesStayFiniteUnderAnyLight) {
  const Scene scene = MakeScene(test::IcoSphere({0, 0, 0}, 1, 2));
  RenderSpec spec = {.width = 16, .height = 16};
  std::vector<Light> lights;
  for (const double intensity : {0.0, 1.0, 1e300, std::numeric_limits<double>::max()}) {
    for (const double distance : {1e-300, 1.0000001, 1e150, 1e308}) {
      Light lamp = Lamp(Vec3d{0, 0, distance});
      lamp.intensity = intensity;
      lamp.color = {1, 0, 0.5f};
      lights.push_back(lamp);
      Light sun = Sun({0, distance, -distance});
      sun.intensity = intensity;
      lights.push_back(sun);
    }
  }
  spec.lights = lights;
  spec.shadows = true;
  spec.color = {1, 0, 1};
  spec.samples = 3;
  const RenderedImage image = RenderOk(scene, spec);
  for (const float value : std::get<Film<float>>(image.values).values()) {
    ASSERT_TRUE(std::isfinite(value));
  }
}

TEST(Light, RefusesInvalidLights) {
  const Scene scene = MakeScene(test::Cube({0, 0, 0}, 1));
  const auto field_of = [&](const Light& light) {
    RenderSpec spec = {.width = 2, .height = 2};
    spec.lights = {light};
    return Render(scene, spec).error().field;
  };
  EXPECT_EQ(field_of(Sun({})), "lights");
  EXPECT_EQ(field_of(Sun({NAN, 0, 0})), "lights");
  EXPECT_EQ(field_of(Lamp({HUGE_VAL, 0, 0})), "lights");
  Light light = Sun({0, 0, 1});
  light.intensity = -1;
  EXPECT_EQ(field_of(light), "lights");
  light.intensity = NAN;
  EXPECT_EQ(field_of(light), "lights");
  light.intensity = 1;
  light.color = {0, 2, 0};
  EXPECT_EQ(field_of(light), "lights");
  RenderSpec spec = {.width = 2, .height = 2};
  spec.lights = std::vector<Light>(RenderSpec::kMaxLights + 1);
  EXPECT_EQ(Render(scene, spec).error().field, "lights");
  spec.lights->pop_back();
  EXPECT_TRUE(Render(scene, spec).ok());
}

}  // namespace
}  // namespace kdray::core
