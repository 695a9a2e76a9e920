// SPDX-License-Identifier: Apache-2.0
#include "core/render/camera.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
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

// ---- Matrices ----

// A random rotation: rows are the camera's axes right, down, forward in world axes.
std::array<Vec3d, 3> RandomRotation(std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  const auto vector = [&] { return Vec3d{normal(random), normal(random), normal(random)}; };
  const Vec3d forward = Normalized(vector());
  const Vec3d right = Normalized(Cross(vector(), forward));
  return {right, Cross(forward, right), forward};
}

Extrinsics MatrixOf(const std::array<Vec3d, 3>& rows, const Vec3d& translation) {
  return {rows[0].x, rows[0].y, rows[0].z, translation.x,
          rows[1].x, rows[1].y, rows[1].z, translation.y,
          rows[2].x, rows[2].y, rows[2].z, translation.z,
          0,         0,         0,         1};
}

TEST(Matrices, GiveTheRaysOfOpen3DsCreateRaysPinhole) {
  // Its formula: the origin is where extrinsic * origin = 0, and extrinsic * direction, without the
  // translation, is ((i + .5 - cx) / fx, (j + .5 - cy) / fy, 1).
  std::mt19937_64 random = RandomEngine(111);
  std::uniform_real_distribution<double> unit(0, 1);
  for (int round = 0; round < 300; ++round) {
    const std::array<Vec3d, 3> rows = RandomRotation(random);
    const Vec3d translation = {unit(random) * 9 - 4, unit(random) * 9 - 4, unit(random) * 9};
    const Intrinsics k = {.fx = 50 + 900 * unit(random),
                          .fy = 50 + 900 * unit(random),
                          .cx = 900 * unit(random) - 100,
                          .cy = 900 * unit(random) - 100};
    const Camera camera =
        LookFrom({.intrinsic = k, .extrinsic = MatrixOf(rows, translation)}, 640, 480);
    const int i = static_cast<int>(640 * unit(random));
    const int j = static_cast<int>(480 * unit(random));
    const Ray ray = camera.RayThrough(i + 0.5, j + 0.5);
    const auto to_camera = [&](const Vec3d& v) {
      return Vec3d{Dot(rows[0], v), Dot(rows[1], v), Dot(rows[2], v)};
    };
    ExpectNear(to_camera(ray.origin) + translation, {}, 1e-14);
    ExpectNear(to_camera(ray.direction), {(i + .5 - k.cx) / k.fx, (j + .5 - k.cy) / k.fy, 1.0},
               1e-13);
    const Camera::ImagePoint back = camera.ToImage(camera.ToView(ray.origin + ray.direction * 3.0));
    EXPECT_NEAR(back.x_px, i + 0.5, 1e-9);
    EXPECT_NEAR(back.y_px, j + 0.5, 1e-9);
  }
}

TEST(Matrices, MayBeOrthonormalToSixDigitsAndAreThenInverted) {
  std::array<Vec3d, 3> rows = {Vec3d{1, 0, 0}, Vec3d{0, 1, 4e-7}, Vec3d{3e-7, 0, 1 + 4e-7}};
  const Camera camera = LookFrom({.extrinsic = MatrixOf(rows, {0, 0, 2})}, 64, 48);
  const Ray ray = camera.RayThrough(7.5, 9.5);
  EXPECT_NEAR(Dot(rows[2], ray.direction), 1, 1e-15);
  EXPECT_NEAR(Dot(rows[2], ray.origin), -2, 1e-15);
  EXPECT_NEAR(Dot(rows[0], ray.origin), 0, 1e-15);
}

TEST(Matrices, OfIntrinsicsAloneFrameTheMesh) {
  for (const auto& [cx, cy] : {std::pair{320.0, 240.0}, {100.0, 400.0}, {-300.0, 900.0}}) {
    const Intrinsics k = {.fx = 500, .fy = 400, .cx = cx, .cy = cy};
    for (const std::optional<View> view : {std::optional<View>(), {View::kTop}}) {
      const Camera camera = LookFrom({.view = view, .intrinsic = k}, 640, 480);
      const Camera::ImagePoint middle = camera.ToImage(camera.ToView({}));
      EXPECT_NEAR(middle.x_px, 320, 1e-9);
      EXPECT_NEAR(middle.y_px, 240, 1e-9);
      double from_middle = 0;
      for (unsigned i = 0; i < 8; ++i) {
        const Camera::ViewPoint seen = camera.ToView(kUnitBox.Corner(i));
        ASSERT_GT(seen.depth, 0);
        const Camera::ImagePoint at = camera.ToImage(seen);
        from_middle =
            std::max({from_middle, std::abs(at.x_px / 320 - 1), std::abs(at.y_px / 240 - 1)});
      }
      EXPECT_NEAR(from_middle, kFramedShare, 1e-9);
    }
  }
}

TEST(Matrices, OfExtrinsicsAloneHaveTheDefaultFieldOfView) {
  const Extrinsics m = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 5, 0, 0, 0, 1};
  const Camera camera = LookFrom({.extrinsic = m}, 200, 100);
  EXPECT_EQ(camera.eye, (Vec3d{0, 0, -5}));
  EXPECT_EQ(camera.forward, (Vec3d{0, 0, 1}));
  EXPECT_EQ(camera.upward, (Vec3d{0, -1, 0}));
  const double half = std::tan(20 * std::numbers::pi / 180);
  ExpectNear(camera.RayThrough(200, 0).direction, {2 * half, -half, 1}, 1e-15);
}

// ---- Spherical ----

TEST(Spherical, DirectionsFollowAzimuthAndElevation) {
  std::mt19937_64 random = RandomEngine(112);
  std::uniform_real_distribution<double> unit(0, 1);
  const auto degrees = [](double d) { return d * std::numbers::pi / 180; };
  for (int round = 0; round < 300; ++round) {
    const std::array<Vec3d, 3> axes = RandomRotation(random);  // r, -u, f
    const Vec3d r = axes[0], u = -axes[1], f = axes[2];
    const double view_elevation = degrees(160 * unit(random) - 80);
    const double h_fov = 360 * (1 - unit(random));
    const double v_fov = 180 * (1 - unit(random));
    const Vec3d eye = {unit(random), unit(random), unit(random)};
    const Camera camera = LookFrom(
        {.projection = Projection::kSpherical,
         .eye = eye,
         .target = eye + (f * std::cos(view_elevation) + u * std::sin(view_elevation)) * 7.0,
         .up = u * 3.0,
         .h_fov_deg = h_fov,
         .v_fov_deg = v_fov},
        360, 90);
    const double e0 = std::clamp(view_elevation, degrees(v_fov / 2 - 90), degrees(90 - v_fov / 2));
    for (const auto& [i, j] : {std::pair{0, 0}, {359, 89}, {180, 45}, {17, 60}}) {
      const double a = ((i + .5) / 360 - .5) * degrees(h_fov);
      const double e = e0 + (.5 - (j + .5) / 90) * degrees(v_fov);
      const Ray ray = camera.RayThrough(i + 0.5, j + 0.5);
      EXPECT_EQ(ray.origin, eye);
      EXPECT_NEAR(Length(ray.direction), 1, 1e-15);
      ExpectNear(ray.direction, (f * std::cos(a) + r * std::sin(a)) * std::cos(e) + u * std::sin(e),
                 1e-13);
    }
  }
}

TEST(Spherical, LooksFromTheMiddleOfTheBoxAllAround) {
  const Camera camera =
      LookFrom({.projection = Projection::kSpherical, .view = View::kFront}, 4, 2);
  EXPECT_EQ(camera.eye, Vec3d{});
  ExpectNear(camera.RayThrough(2, 1).direction, {0, 0, -1}, 1e-15);
  ExpectNear(camera.RayThrough(3, 1).direction, {1, 0, 0}, 1e-15);
  ExpectNear(camera.RayThrough(1, 1).direction, {-1, 0, 0}, 1e-15);
  ExpectNear(camera.RayThrough(0, 1).direction, {0, 0, 1}, 1e-15);
  ExpectNear(camera.RayThrough(2, 0).direction, {0, 1, 0}, 1e-15);
}

TEST(Spherical, AFlatCameraAtAPixelHasItsNeighboursWhereTheyAre) {
  const Camera camera =
      LookFrom({.projection = Projection::kSpherical, .eye = Vec3d{1, 2, 3}}, 3600, 1800);
  for (const auto& [x, y] : {std::pair{1800.5, 900.5}, {3.5, 300.5}, {2000.5, 1500.5}}) {
    const Camera flat = camera.FlatAt(x, y);
    for (const auto& [dx, dy] : {std::pair{0.0, 0.0}, {1.0, 0.0}, {0.0, -1.0}, {-1.0, 1.0}}) {
      const Ray ray = camera.RayThrough(x + dx, y + dy);
      const Camera::ViewPoint seen = flat.ToView(ray.origin + ray.direction * 5.0);
      EXPECT_NEAR(flat.ToImage(seen).x_px, x + dx, 0.01);
      EXPECT_NEAR(flat.ToImage(seen).y_px, y + dy, 0.01);
      EXPECT_NEAR(seen.depth, 5, 1e-4);
    }
  }
}

// ---- Framing ----

TEST(Framing, SeesAnAsymmetricMeshFromTheSideOfTheView) {
  struct Case {
    View view;
    Vec3d toward, up;  // from the mesh to the eye, and up in the image, if y is up
  };
  const Vec3d x = {1, 0, 0}, y = {0, 1, 0}, z = {0, 0, 1};
  const Vec3d corner = Normalized(Vec3d{1, 1, 1});
  const std::vector<Case> cases = {{View::kFront, z, y},
                                   {View::kBack, -z, y},
                                   {View::kLeft, -x, y},
                                   {View::kRight, x, y},
                                   {View::kTop, y, -z},
                                   {View::kBottom, -y, z},
                                   {View::kIso, corner, Normalized(y - corner * corner.y)}};
  // With z up, the front is -y, so (x, y, z) become (x, z, -y).
  const auto with_z_up = [](const Vec3d& v) { return Vec3d{v.x, -v.z, v.y}; };
  const Bounds3d box = {{1, 2, 3}, {2, 4, 8}};
  for (const Case& c : cases) {
    for (const Projection projection : {Projection::kPerspective, Projection::kOrthographic}) {
      for (const auto& up : {std::optional<Vec3d>(), {y}, {z * 3.0}}) {
        const Result<Camera> camera =
            ResolveCamera({.projection = projection, .up = up, .view = c.view}, box, 300, 200);
        ASSERT_TRUE(camera.ok()) << camera.error().message;
        const bool z_up = up && up->z != 0;
        ExpectNear(camera->forward, -(z_up ? with_z_up(c.toward) : c.toward), 1e-15);
        ExpectNear(camera->upward, z_up ? with_z_up(c.up) : c.up, 1e-15);
        const Camera::ImagePoint middle = camera->ToImage(camera->ToView(box.Center()));
        EXPECT_NEAR(middle.x_px, 150, 1e-9);
        EXPECT_NEAR(middle.y_px, 100, 1e-9);
        const Extent extent = ExtentInImage(*camera, box);
        EXPECT_GT(extent.nearest, 0);
        EXPECT_GE(std::min(extent.left, extent.top), 0);
        EXPECT_LE(extent.right, 300);
        EXPECT_LE(extent.bottom, 200);
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
      {{.h_fov_deg = 0.0}, "h_fov_deg"},
      {{.h_fov_deg = 361.0}, "h_fov_deg"},
      {{.v_fov_deg = 0.0}, "v_fov_deg"},
      {{.v_fov_deg = 181.0}, "v_fov_deg"},
      {{.intrinsic = Intrinsics{.fx = 0, .fy = 1}}, "intrinsic"},
      {{.intrinsic = Intrinsics{.fx = 1, .fy = -1}}, "intrinsic"},
      {{.intrinsic = Intrinsics{.fx = 1, .fy = 1, .cx = kNan}}, "intrinsic"},
      {{.intrinsic = Intrinsics{.fx = 1e-308, .fy = 1}}, "intrinsic"},
      {{.fov_deg = 1e-320}, "fov_deg"},
      {{.projection = Projection::kOrthographic, .view_height = 1.7e308}, "view_height"},
      {{.extrinsic = Extrinsics{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1}}, "extrinsic"},
      {{.extrinsic = Extrinsics{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 2}}, "extrinsic"},
      {{.extrinsic = Extrinsics{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 1, 0, 1}}, "extrinsic"},
      {{.extrinsic = Extrinsics{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 2, 0, 0, 0, 0, 1}}, "extrinsic"},
      {{.extrinsic = Extrinsics{1, 2e-6, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}}, "extrinsic"},
      {{.extrinsic = Extrinsics{1, 0, 0, 1e308, 0, 1, 0, 1e308, 0, 0, 1, kInf, 0, 0, 0, 1}},
       "extrinsic"},
      {{.projection = Projection::kSpherical,
        .eye = Vec3d{},
        .target = Vec3d{0, -2, 0},
        .up = Vec3d{0, 1, 0}},
       "up"},
      {{.projection = Projection::kSpherical, .up = Vec3d{0, 0, 1}, .view = View::kTop}, "up"},
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
