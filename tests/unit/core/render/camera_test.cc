#include "core/render/camera.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "core/render/framing.h"
#include "tests/support/seed.h"

namespace kdray::core {
namespace {

using ::kdray::test::RandomEngine;

const Bounds3d kUnitBox = {{-0.5, -0.5, -0.5}, {0.5, 0.5, 0.5}};

void ExpectNear(const Vec3d& actual, const Vec3d& expected, double tolerance) {
  EXPECT_NEAR(actual.x, expected.x, tolerance);
  EXPECT_NEAR(actual.y, expected.y, tolerance);
  EXPECT_NEAR(actual.z, expected.z, tolerance);
}

Camera LookFrom(const CameraSpec& spec, int width, int height) {
  Result<Camera> camera = ResolveCamera(spec, kUnitBox, width, height);
  EXPECT_TRUE(camera.ok()) << camera.error().message;
  return *camera;
}

TEST(Camera, PerspectiveRaysHaveTheClosedFormOfAPinhole) {
  const Camera camera =
      LookFrom({.eye = Vec3d{0, 0, 5}, .target = Vec3d{}, .fov_deg = 90.0}, 200, 100);
  // At depth 1 a vertical angle of 90 degrees shows y from 1 to -1, and x twice as far.
  const Ray top_left = camera.RayThrough(0, 0);
  EXPECT_EQ(top_left.origin, (Vec3d{0, 0, 5}));
  ExpectNear(top_left.direction, {-2, 1, -1}, 1e-15);
  ExpectNear(camera.RayThrough(200, 100).direction, {2, -1, -1}, 1e-15);
  ExpectNear(camera.RayThrough(100, 50).direction, {0, 0, -1}, 1e-15);
  EXPECT_EQ(top_left.t_min, 0);
  EXPECT_EQ(top_left.t_max, std::numeric_limits<double>::infinity());
}

TEST(Camera, OrthographicRaysAreParallelAndAPixelApart) {
  const Camera camera = LookFrom({.projection = Projection::kOrthographic,
                                  .eye = Vec3d{7, 0, 0},
                                  .target = Vec3d{},
                                  .up = Vec3d{0, 0, 1},
                                  .view_height = 4.0},
                                 40, 20);
  // Looking along -x with z up, the image's x axis is +y.
  ExpectNear(camera.RayThrough(0, 0).origin, {7, -4, 2}, 1e-15);
  ExpectNear(camera.RayThrough(40, 20).origin, {7, 4, -2}, 1e-15);
  ExpectNear(camera.RayThrough(3, 9).direction, {-1, 0, 0}, 1e-15);
  EXPECT_NEAR(camera.PixelSize(123), 0.2, 1e-15);
}

TEST(Camera, RowZeroIsTheTopAndColumnsRunRightHanded) {
  const Camera camera = LookFrom({.eye = Vec3d{0, 0, 5}, .target = Vec3d{}}, 64, 48);
  EXPECT_LT(camera.ToImage(camera.ToView({0, 0.4, 0})).y_px, 24);
  EXPECT_GT(camera.ToImage(camera.ToView({0.4, 0, 0})).x_px, 32);
  ExpectNear(Cross(camera.right, camera.upward), -camera.forward, 1e-15);
}

TEST(Camera, DepthIsTheRayParameterAndPixelsComeBackFromPoints) {
  std::mt19937_64 random = RandomEngine(101);
  std::uniform_real_distribution<double> coordinate(-3, 3);
  std::uniform_real_distribution<double> unit(0, 1);
  for (int i = 0; i < 1000; ++i) {
    CameraSpec spec;
    spec.projection = i % 2 == 0 ? Projection::kPerspective : Projection::kOrthographic;
    spec.eye = Vec3d{coordinate(random), coordinate(random), coordinate(random)};
    spec.target = Vec3d{coordinate(random), coordinate(random), coordinate(random)};
    spec.up = Vec3d{coordinate(random), coordinate(random), coordinate(random)};
    spec.fov_deg = 1 + 170 * unit(random);
    spec.view_height = 0.1 + 10 * unit(random);
    const Camera camera = LookFrom(spec, 320, 200);
    const double x = 320 * unit(random);
    const double y = 200 * unit(random);
    const double depth = 0.01 + 10 * unit(random);
    const Ray ray = camera.RayThrough(x, y);
    const Camera::ViewPoint seen = camera.ToView(ray.origin + ray.direction * depth);
    EXPECT_NEAR(seen.depth, depth, 1e-13 * (1 + depth));
    EXPECT_NEAR(camera.ToImage(seen).x_px, x, 1e-7);
    EXPECT_NEAR(camera.ToImage(seen).y_px, y, 1e-7);
  }
}

TEST(Framing, SeesTheMeshFromTheFrontRightAndAboveWithAnyUp) {
  const double elevation = 20 * std::numbers::pi / 180;
  const double azimuth = 30 * std::numbers::pi / 180;
  const double ahead = std::cos(elevation) * std::cos(azimuth);
  const double aside = std::cos(elevation) * std::sin(azimuth);
  const double above = std::sin(elevation);
  ExpectNear(LookFrom({}, 64, 64).forward, -Vec3d{aside, above, ahead}, 1e-12);
  ExpectNear(LookFrom({.up = Vec3d{0, 0, 2}}, 64, 64).forward, -Vec3d{aside, -ahead, above}, 1e-12);
  ExpectNear(LookFrom({.up = Vec3d{0, -1, 0}}, 64, 64).forward, -Vec3d{aside, -above, -ahead},
             1e-12);
}

// Boxes of every kind: cubes, slabs, rods and points, tiny and huge, at 0 and far from it.
std::vector<Bounds3d> ManyBoxes() {
  std::vector<Bounds3d> boxes;
  std::mt19937_64 random = RandomEngine(102);
  std::uniform_real_distribution<double> unit(0, 1);
  for (const double scale : {1e-30, 1e-15, 1.0, 1e15, 1e30}) {
    for (const double offset : {0.0, 3.0, 1e5}) {
      for (int flat = 0; flat < 8; ++flat) {
        Bounds3d box;
        for (int axis = 0; axis < 3; ++axis) {
          box.min[axis] = scale * offset * (unit(random) - 0.5);
          const bool is_flat = (flat >> axis & 1) != 0;
          box.max[axis] = box.min[axis] + (is_flat ? 0 : scale * (0.1 + unit(random)));
        }
        boxes.push_back(box);
      }
    }
  }
  boxes.push_back({{0, 0, 0}, {0, 0, 0}});
  boxes.push_back({{-3.4e38, -3.4e38, -3.4e38}, {3.4e38, 3.4e38, 3.4e38}});
  boxes.push_back({{0, 0, 0}, {1e-38, 1e-44, 0}});
  return boxes;
}

struct Extent {
  double left = 1e300, right = -1e300, top = 1e300, bottom = -1e300, nearest = 1e300;
};

Extent ExtentInImage(const Camera& camera, const Bounds3d& box) {
  Extent extent;
  for (unsigned i = 0; i < 8; ++i) {
    const Camera::ViewPoint seen = camera.ToView(box.Corner(i));
    const Camera::ImagePoint at = camera.ToImage(seen);
    extent.left = std::min(extent.left, at.x_px);
    extent.right = std::max(extent.right, at.x_px);
    extent.top = std::min(extent.top, at.y_px);
    extent.bottom = std::max(extent.bottom, at.y_px);
    extent.nearest = std::min(extent.nearest, seen.depth);
  }
  return extent;
}

TEST(Framing, ShowsAllCornersOfAnyBoxInAnyImage) {
  for (const Bounds3d& box : ManyBoxes()) {
    for (const Projection projection : {Projection::kPerspective, Projection::kOrthographic}) {
      for (const auto& [width, height] : {std::pair{640, 480}, {100, 1000}, {2000, 10}, {1, 1}}) {
        for (const Vec3d& up : {Vec3d{0, 1, 0}, {0, 0, 1}, {-1, -2, 3}, {0, -1, 0}}) {
          for (const double fov_deg : {1.0, 40.0, 150.0}) {
            const Result<Camera> camera = ResolveCamera(
                {.projection = projection, .up = up, .fov_deg = fov_deg}, box, width, height);
            ASSERT_TRUE(camera.ok()) << camera.error().message;
            const Extent extent = ExtentInImage(*camera, box);
            // The box's own coordinates carry rounding errors of 1e5 box sizes.
            const double slack = 1e-7 * std::max(width, height);
            const double margin_x = (1 - kFramedShare) / 2 * width - slack;
            const double margin_y = (1 - kFramedShare) / 2 * height - slack;
            ASSERT_GT(extent.nearest, 0);
            ASSERT_GE(extent.left, margin_x);
            ASSERT_LE(extent.right, width - margin_x);
            ASSERT_GE(extent.top, margin_y);
            ASSERT_LE(extent.bottom, height - margin_y);
          }
        }
      }
    }
  }
}

TEST(Framing, GoesAsNearAsTheBoxFits) {
  for (const Projection projection : {Projection::kPerspective, Projection::kOrthographic}) {
    for (const auto& [width, height] : {std::pair{640, 480}, {300, 900}}) {
      const Bounds3d box = {{1, 2, 3}, {2, 2.5, 7}};
      const Result<Camera> camera =
          ResolveCamera({.projection = projection, .up = Vec3d{1, 2, 3}}, box, width, height);
      ASSERT_TRUE(camera.ok());
      EXPECT_EQ(camera->target, box.Center());
      const Extent extent = ExtentInImage(*camera, box);
      const double from_middle =
          std::max({1 - 2 * extent.left / width, 2 * extent.right / width - 1,
                    1 - 2 * extent.top / height, 2 * extent.bottom / height - 1});
      EXPECT_NEAR(from_middle, kFramedShare, 1e-9);
    }
  }
}

TEST(Framing, KeepsAGivenTargetInTheMiddleAndTheBoxInView) {
  const Vec3d target = {3, -1, 0.5};
  for (const Projection projection : {Projection::kPerspective, Projection::kOrthographic}) {
    const Camera camera = LookFrom({.projection = projection, .target = target}, 640, 480);
    EXPECT_EQ(camera.target, target);
    const Camera::ImagePoint middle = camera.ToImage(camera.ToView(target));
    EXPECT_NEAR(middle.x_px, 320, 1e-9);
    EXPECT_NEAR(middle.y_px, 240, 1e-9);
    const Extent extent = ExtentInImage(camera, kUnitBox);
    EXPECT_GT(extent.nearest, 0);
    EXPECT_GE(std::min(extent.left, extent.top), 0);
    EXPECT_LE(extent.right, 640);
    EXPECT_LE(extent.bottom, 480);
  }
}

TEST(Framing, LooksFromAGivenEyeAtTheMiddleOfTheBox) {
  const Camera camera = LookFrom({.eye = Vec3d{5, 6, 7}}, 64, 48);
  EXPECT_EQ(camera.eye, (Vec3d{5, 6, 7}));
  EXPECT_EQ(camera.target, Vec3d{});
  ExpectNear(camera.forward, Normalized(Vec3d{-5, -6, -7}), 1e-15);
}

TEST(Framing, LooksTheUsualWayFromAnEyeInTheMiddleOfTheBox) {
  const Camera usual = LookFrom({}, 64, 48);
  const Camera camera = LookFrom({.eye = Vec3d{}}, 64, 48);
  ExpectNear(camera.forward, usual.forward, 1e-15);
  EXPECT_NE(camera.target, camera.eye);
}

TEST(Framing, ChoosesTheLeastViewHeightAroundAGivenAxis) {
  const Camera camera = LookFrom({.projection = Projection::kOrthographic,
                                  .eye = Vec3d{0.25, 0, 9},
                                  .target = Vec3d{0.25, 0, 0}},
                                 100, 100);
  EXPECT_NEAR(camera.view_height, 1.5 / kFramedShare, 1e-12);
}

TEST(Framing, FindsAnUpWhenNoneIsGivenAndTheViewIsVertical) {
  const Camera down = LookFrom({.eye = Vec3d{0, 9, 0}, .target = Vec3d{}}, 64, 48);
  EXPECT_EQ(down.up, (Vec3d{0, 0, -1}));
  ExpectNear(down.right, {1, 0, 0}, 1e-15);
  const Camera up = LookFrom({.eye = Vec3d{0, -9, 0}, .target = Vec3d{}}, 64, 48);
  EXPECT_EQ(up.up, (Vec3d{0, 0, 1}));
  ExpectNear(up.right, {1, 0, 0}, 1e-15);
}

TEST(Framing, TakesVectorsOfAnyLength) {
  for (const double length : {1e-300, 1e-30, 1e30, 1e300}) {
    const Camera camera =
        LookFrom({.eye = Vec3d{0, 0, length}, .target = Vec3d{}, .up = Vec3d{0, length, 0}}, 9, 9);
    ExpectNear(camera.forward, {0, 0, -1}, 1e-15);
    ExpectNear(camera.upward, {0, 1, 0}, 1e-15);
  }
}

TEST(Framing, RefusesWhatMakesNoView) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  constexpr double kInf = std::numeric_limits<double>::infinity();
  struct Case {
    CameraSpec spec;
    std::string field;
  };
  const std::vector<Case> cases = {
      {{.eye = Vec3d{kNan, 0, 0}}, "eye"},
      {{.target = Vec3d{0, kInf, 0}}, "target"},
      {{.up = Vec3d{0, 0, kNan}}, "up"},
      {{.up = Vec3d{}}, "up"},
      {{.eye = Vec3d{1, 2, 3}, .target = Vec3d{1, 2, 3}}, "eye"},
      {{.eye = Vec3d{0, 0, -1.7e308}, .target = Vec3d{0, 0, 1.7e308}}, "eye"},
      {{.eye = Vec3d{0, 0, 3}, .target = Vec3d{}, .up = Vec3d{0, 0, -2}}, "up"},
      {{.eye = Vec3d{0, 0, 3}, .target = Vec3d{}, .up = Vec3d{0, 1e-12, 1}}, "up"},
      {{.fov_deg = 0.0}, "fov_deg"},
      {{.fov_deg = 180.0}, "fov_deg"},
      {{.fov_deg = kNan}, "fov_deg"},
      {{.view_height = 0.0}, "view_height"},
      {{.view_height = -1.0}, "view_height"},
      {{.view_height = kInf}, "view_height"},
  };
  for (const Case& c : cases) {
    const Result<Camera> camera = ResolveCamera(c.spec, kUnitBox, 64, 48);
    ASSERT_FALSE(camera.ok()) << c.field;
    EXPECT_EQ(camera.error().code, ErrorCode::kInvalidArgument);
    EXPECT_EQ(camera.error().field, c.field);
  }
}

}  // namespace
}  // namespace kdray::core
