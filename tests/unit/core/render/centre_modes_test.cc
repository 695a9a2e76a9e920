// SPDX-License-Identifier: Apache-2.0
// The modes of one sample a pixel against closed forms and the trace, and all modes against their
// own regions.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <numbers>
#include <stdexcept>
#include <vector>

#include "core/geometry/surface_point.h"
#include "core/render/centre_values.h"
#include "core/render/depth_range.h"
#include "core/render/picture_precision.h"
#include "core/render/renderer.h"
#include "core/trace/trace.h"
#include "tests/support/scenes.h"
#include "tests/support/shapes.h"

namespace kdray::core {
namespace {

RenderedImage RenderOk(const Scene& scene, const RenderSpec& spec) {
  Result<RenderedImage> image = Render(scene, spec);
  if (!image.ok()) throw std::runtime_error(image.error().message);
  return *std::move(image);
}

Scene Bumpy() { return test::MakeScene(test::BumpySphere({1, 2, 3}, 2, 20, 30, 0.3)); }

template <class F>
void ForEachPixel(const RenderedImage& image, const F& f) {
  const Region& r = image.region();
  for (int y = r.y0; y < r.y1; ++y) {
    for (int x = r.x0; x < r.x1; ++x) f(x, y);
  }
}

TEST(DepthMode, OfAPlaneIsTheDistanceAlongTheViewAxis) {
  // The plane z = 0 from a height of 2 along a tilted axis: a ray that falls h per unit of depth
  // has depth 2 / h.
  const Scene scene = test::MakeScene(test::Grid(4, 2, 0));
  RenderSpec spec = {.width = 60, .height = 40, .mode = RenderMode::kDepth};
  spec.precision = Precision::kExact;
  spec.camera = {.eye = Vec3d{0.4, 0.3, 2}, .target = Vec3d{0.7, 0.5, 0}};
  const RenderedImage image = RenderOk(scene, spec);
  int hits = 0;
  ForEachPixel(image, [&](int x, int y) {
    const float depth = std::get<Film<float>>(image.values)(x, y)[0];
    if (std::isinf(depth)) return;
    ++hits;
    const Ray ray = image.camera.RayThrough(x + 0.5, y + 0.5);
    ASSERT_EQ(depth, static_cast<float>(2 / -ray.direction.z));
  });
  EXPECT_GT(hits, 100);
}

TEST(DepthMode, OfASphericalImageIsTheDistanceAlongTheRay) {
  // From the middle of a cube of half side 1, the distance along a unit d is 1 / max |d|.
  const Scene scene = test::MakeScene(test::Cube({1, 2, 3}, 1));
  RenderSpec spec = {.width = 90, .height = 45, .mode = RenderMode::kDepth};
  spec.camera.projection = Projection::kSpherical;
  const RenderedImage image = RenderOk(scene, spec);
  ForEachPixel(image, [&](int x, int y) {
    const Ray ray = image.camera.RayThrough(x + 0.5, y + 0.5);
    ASSERT_NEAR(std::get<Film<float>>(image.values)(x, y)[0], 1 / MaxAbs(ray.direction), 1e-6);
  });
}

TEST(DepthMode, OfASphereIsThatOfTheSphere) {
  const Scene scene = test::MakeScene(test::IcoSphere({0, 0, 0}, 1, 6));
  RenderSpec spec = {.width = 40, .height = 40, .mode = RenderMode::kDepth};
  spec.camera.eye = Vec3d{0, 0, 4};
  const RenderedImage image = RenderOk(scene, spec);
  for (const auto& [x, y] : {std::pair{20, 20}, {15, 22}, {24, 12}}) {
    const Vec3d d = image.camera.RayThrough(x + 0.5, y + 0.5).direction;
    const Vec3d o = {0, 0, 4};
    const double b = Dot(o, d), a = Dot(d, d), c = Dot(o, o) - 1;
    const double t = (-b - std::sqrt(b * b - a * c)) / a;
    // The mesh lies up to 1e-3 inside the sphere.
    EXPECT_NEAR(std::get<Film<float>>(image.values)(x, y)[0], t, 3e-3);
  }
}

TEST(CostMode, CountsWhatTheTraceCounts) {
  for (const BuildKind build : {BuildKind::kKdSah, BuildKind::kBvh, BuildKind::kBox}) {
    const Scene scene = test::MakeScene(test::BumpySphere({1, 2, 3}, 2, 20, 30, 0.3), build);
    const RenderSpec spec = {.width = 40, .height = 30, .mode = RenderMode::kCost};
    const RenderedImage image = RenderOk(scene, spec);
    const auto& film = std::get<Film<std::int32_t>>(image.values);
    ASSERT_EQ(film.channels(), 2);
    std::vector<Ray> rays;
    SetCentreRays(image.camera, image.region(), &rays);
    std::vector<Hit> hits(rays.size());
    std::vector<TraceCost> costs(rays.size());
    ASSERT_TRUE(TraceCostly(scene, std::span<const Ray>(rays), {}, hits, costs).ok());
    std::size_t i = 0;
    std::int64_t steps = 0;
    ForEachPixel(image, [&](int x, int y) {
      ASSERT_EQ(film(x, y)[0], static_cast<std::int32_t>(costs[i].nodes_visited));
      ASSERT_EQ(film(x, y)[1], static_cast<std::int32_t>(costs[i].triangles_tested));
      steps += film(x, y)[0] + film(x, y)[1];
      ++i;
    });
    EXPECT_GT(steps, 1000);
  }
}

TEST(PositionMode, IsThePointOfTheTriangleAndOfTheRay) {
  const Scene scene = Bumpy();
  for (const Projection projection :
       {Projection::kPerspective, Projection::kOrthographic, Projection::kSpherical}) {
    RenderSpec spec = {.width = 50, .height = 40, .mode = RenderMode::kPosition};
    spec.camera.projection = projection;
    if (projection == Projection::kSpherical) spec.camera.eye = Vec3d{1, 2, 8};
    const RenderedImage image = RenderOk(scene, spec);
    const auto& film = std::get<Film<double>>(image.values);
    int hits = 0, misses = 0;
    ForEachPixel(image, [&](int x, int y) {
      const Ray ray = image.camera.RayThrough(x + 0.5, y + 0.5);
      const Hit hit = ClosestHit(scene, ray, Precision::kWatertight);
      const Vec3d point = {film(x, y)[0], film(x, y)[1], film(x, y)[2]};
      if (!hit.IsHit()) {
        ++misses;
        ASSERT_TRUE(std::isnan(point.x) && std::isnan(point.y) && std::isnan(point.z));
        return;
      }
      ++hits;
      ASSERT_EQ(point, SurfacePoint(*scene.mesh, hit));
      ASSERT_LT(MaxAbs(point - (ray.origin + ray.direction * hit.t)), 1e-6);
    });
    EXPECT_GT(hits, 50);
    EXPECT_GT(misses, 50);
  }
}

TEST(PositionMode, HasNoNegativeZero) {
  MeshData mesh;
  mesh.vertices = {{-1, -1, -0.0}, {1, -1, -0.0}, {-0.0, 1, -0.0}};
  mesh.triangles = {{0, 1, 2}};
  RenderSpec spec = {.width = 9, .height = 9, .mode = RenderMode::kPosition};
  spec.camera.view = View::kFront;
  const RenderedImage image = RenderOk(test::MakeScene(mesh), spec);
  for (const double value : std::get<Film<double>>(image.values).values()) {
    EXPECT_FALSE(value == 0 && std::signbit(value));
  }
}

TEST(Regions, JoinBitForBitInEveryModeAndProjection) {
  const Scene scene = Bumpy();
  for (const Projection projection :
       {Projection::kPerspective, Projection::kOrthographic, Projection::kSpherical}) {
    for (const RenderMode mode :
         {RenderMode::kShaded, RenderMode::kNormal, RenderMode::kDepth, RenderMode::kTriangle,
          RenderMode::kCost, RenderMode::kPosition}) {
      for (const bool has_matrix : {false, true}) {
        if (has_matrix && projection != Projection::kPerspective) continue;
        RenderSpec spec = {.width = 75, .height = 50, .mode = mode, .samples = 3};
        spec.precision = std::nullopt;
        spec.camera.projection = projection;
        if (projection == Projection::kSpherical) spec.camera.eye = Vec3d{1, 2, 6};
        if (has_matrix) spec.camera.intrinsic = Intrinsics{.fx = 70, .fy = 60, .cx = 20, .cy = 30};
        const RenderedImage whole = RenderOk(scene, spec);
        for (const Region& region : {Region{0, 0, 40, 50}, {40, 0, 75, 33}, {40, 33, 75, 50}}) {
          spec.region = region;
          const RenderedImage part = RenderOk(scene, spec);
          EXPECT_EQ(part.precision, whole.precision);
          std::visit(
              [&](const auto& film) {
                const auto& all = std::get<std::decay_t<decltype(film)>>(whole.values);
                ForEachPixel(part, [&](int x, int y) {
                  ASSERT_EQ(
                      std::memcmp(film(x, y).data(), all(x, y).data(), film(x, y).size_bytes()), 0);
                });
              },
              part.values);
        }
      }
    }
  }
}

TEST(Regions, OfAnImageAMillionPixelsWideSeeTheirPart) {
  const Scene scene = test::MakeScene(test::Cube({0, 0, 0}, 1));
  RenderSpec spec = {.width = 1 << 20, .height = 1 << 20, .mode = RenderMode::kPosition};
  spec.camera = {.projection = Projection::kOrthographic, .view = View::kFront, .view_height = 2.0};
  const int middle = 1 << 19;
  spec.region = Region{middle - 2, middle - 1, middle + 2, middle + 1};
  const RenderedImage image = RenderOk(scene, spec);
  ForEachPixel(image, [&](int x, int y) {
    const auto point = std::get<Film<double>>(image.values)(x, y);
    EXPECT_NEAR(point[0], (x + 0.5 - middle) * 0x1p-19, 1e-9);
    EXPECT_NEAR(point[1], (middle - y - 0.5) * 0x1p-19, 1e-9);
    EXPECT_EQ(point[2], 1);
  });
}

TEST(DepthRange, OfARegionIsThatOfTheWholeImage) {
  const Scene scene = Bumpy();
  RenderSpec spec = {.width = 90, .height = 70, .mode = RenderMode::kDepth};
  const RenderedImage whole = RenderOk(scene, spec);
  const auto range = RangeOfWholeImage(scene, whole, {});
  ASSERT_TRUE(range.ok() && range->has_value());
  EXPECT_EQ(*range, *RangeOfFilm(whole, {}));
  for (const Region& region : {Region{0, 0, 5, 5}, {40, 30, 60, 50}, {89, 69, 90, 70}}) {
    spec.region = region;
    EXPECT_EQ(*RangeOfWholeImage(scene, RenderOk(scene, spec), {}), *range);
  }
  spec.region.reset();
  spec.camera = {.eye = Vec3d{1, 2, 99}, .target = Vec3d{1, 2, 199}};
  EXPECT_EQ(*RangeOfWholeImage(scene, RenderOk(scene, spec), {}), std::nullopt);
}

TEST(DepthRange, IsNotSoughtAfterACancellation) {
  const Scene scene = Bumpy();
  RenderSpec spec = {.width = 4000, .height = 4000, .mode = RenderMode::kDepth};
  spec.region = Region{0, 0, 4, 4};
  const RenderedImage image = RenderOk(scene, spec);
  const CancelToken late = CancelToken::WithDeadline(std::chrono::steady_clock::now());
  EXPECT_EQ(RangeOfWholeImage(scene, image, late).error().code, ErrorCode::kDeadlineExceeded);
}

TEST(DepthRange, GivesTheGreysOfTheContract) {
  for (const auto& [near, far] : {std::pair{0.0, 1.0}, {2.5, 7.25}, {-3.0, 900.0}}) {
    for (int i = 0; i <= 1000; ++i) {
      const float d = static_cast<float>(near + (far - near) * i / 1000);
      const double clamped = std::clamp(static_cast<double>(d), near, far);
      const double expected = 255 - std::round(254 * (clamped - near) / (far - near));
      ASSERT_EQ(GreyOf({near, far}, d), expected) << d;
    }
  }
  EXPECT_EQ(GreyOf({0, 1}, -5), 255);
  EXPECT_EQ(GreyOf({0, 1}, 5), 1);
  EXPECT_EQ(GreyOf({4, 4}, 5), 255);
  EXPECT_EQ(GreyOf({0, 1}, std::numeric_limits<float>::max()), 1);
}

// ---- precision=auto ----

// A square of side 2 at z = 0.1. Halved in the mesh's frame, only 0.05 is rounded.
Scene DoubleSquare() {
  MeshData mesh;
  mesh.vertices = {{-1, -1, 0.1}, {1, -1, 0.1}, {1, 1, 0.1}, {-1, 1, 0.1}};
  mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
  return test::MakeScene(mesh);
}

Precision AutoOf(const Scene& scene, RenderSpec spec) {
  spec.precision = std::nullopt;
  return RenderOk(scene, spec).precision;
}

TEST(AutoPrecision, OfAPictureIsWatertightWhereFloatsMoveNoHundredthOfAPixel) {
  const Scene scene = DoubleSquare();
  ASSERT_EQ(AutoPrecision(*scene.mesh), Precision::kDouble);
  RenderSpec spec = {.width = 100, .height = 100, .mode = RenderMode::kDepth};
  EXPECT_EQ(AutoOf(scene, spec), Precision::kWatertight);

  const double moved = std::abs(2 * static_cast<double>(static_cast<float>(0.05)) - 0.1);
  spec.camera = {.projection = Projection::kOrthographic, .eye = Vec3d{0, 0, 5}};
  const double limit = 100 * 100 * moved;  // the height of a view with pixels of 100 times that
  for (const auto& [height, precision] : {std::pair{limit * 1.001, Precision::kWatertight},
                                          {limit * 0.999, Precision::kDouble},
                                          {limit * 1000, Precision::kWatertight}}) {
    spec.camera.view_height = height;
    spec.region.reset();
    EXPECT_EQ(AutoOf(scene, spec), precision);
    spec.region = Region{0, 0, 1, 1};
    EXPECT_EQ(AutoOf(scene, spec), precision) << "the camera of the whole image decides";
  }
}

TEST(AutoPrecision, OfAPictureMeasuresPixelsAtTheNearestPointOfTheBounds) {
  const Scene scene = DoubleSquare();
  const double moved = std::abs(2 * static_cast<double>(static_cast<float>(0.05)) - 0.1);
  RenderSpec spec = {.width = 100, .height = 100, .mode = RenderMode::kDepth};
  for (const Projection projection : {Projection::kPerspective, Projection::kSpherical}) {
    spec.camera = {.projection = projection, .up = Vec3d{0, 1, 0}};
    const bool is_spherical = projection == Projection::kSpherical;
    const double pixel =
        is_spherical ? std::numbers::pi / 100 : 2 * std::tan(20 * std::numbers::pi / 180) / 100;
    const double nearest = 100 * moved / pixel;
    spec.camera.eye = Vec3d{0.5, 0.5, 0.1 + nearest * 1.001};
    spec.camera.target = Vec3d{-3, 0.5, 0.1};
    EXPECT_EQ(AutoOf(scene, spec), Precision::kWatertight);
    spec.camera.eye = Vec3d{0.5, 0.5, 0.1 + nearest * 0.999};
    EXPECT_EQ(AutoOf(scene, spec), Precision::kDouble);
  }
}

TEST(AutoPrecision, OfAPictureFromWithinTheBoundsIsTheTreesOwn) {
  const Scene scene = DoubleSquare();
  RenderSpec spec = {.width = 10, .height = 10, .mode = RenderMode::kDepth};
  spec.camera = {.eye = Vec3d{0.5, 0.5, 0.1}, .target = Vec3d{0, 0, 5}};
  EXPECT_EQ(AutoOf(scene, spec), Precision::kDouble);
  spec.camera.eye = Vec3d{0.5, 0.5, 0.2};
  EXPECT_EQ(AutoOf(scene, spec), Precision::kWatertight);
}

TEST(AutoPrecision, OfAPictureOfFloatsIsWatertightEvenWithShortEdges) {
  MeshData mesh;
  mesh.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0x1p-30, 0, 0}, {0, 0x1p-30, 0}};
  mesh.triangles = {{0, 1, 2}, {0, 3, 4}};
  const Scene scene = test::MakeScene(mesh);
  ASSERT_EQ(AutoPrecision(*scene.mesh), Precision::kDouble);
  RenderSpec spec = {.width = 10, .height = 10, .mode = RenderMode::kDepth};
  EXPECT_EQ(AutoOf(scene, spec), Precision::kWatertight);
}

}  // namespace
}  // namespace kdray::core
