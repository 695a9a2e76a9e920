// SPDX-License-Identifier: Apache-2.0
#include "core/render/renderer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstring>
#include <limits>
#include <set>
#include <string_view>
#include <vector>

#include "core/base/parallel.h"
#include "core/render/pixel_filter.h"
#include "core/render/shading.h"
#include "tests/support/allocation_count.h"
#include "tests/support/scenes.h"
#include "tests/support/shapes.h"

namespace kdray::core {
namespace {

using ::kdray::test::MakeScene;

RenderedImage RenderOk(const Scene& scene, const RenderSpec& spec) {
  Result<RenderedImage> image = Render(scene, spec);
  if (!image.ok()) throw std::runtime_error(image.error().message);
  return *std::move(image);
}

const Film<float>& Floats(const RenderedImage& image) {
  return std::get<Film<float>>(image.values);
}
const Film<float>& Floats(const RenderedImage&& image) =
    delete;  // would not outlive a loop over it
const Film<std::int32_t>& Ids(const RenderedImage& image) {
  return std::get<Film<std::int32_t>>(image.values);
}

// NaN and signs of zero count: the promise is the same bytes.
template <class T>
bool SameBytes(std::span<const T> a, std::span<const T> b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size_bytes()) == 0;
}

bool SameBytes(const RenderedImage& a, const RenderedImage& b) {
  const auto same_film = [](const auto& x, const auto& y) {
    return x.has_value() == y.has_value() && (!x || SameBytes(x->values(), y->values()));
  };
  if (a.values.index() != b.values.index()) return false;
  const bool same_values = a.values.index() == 0 ? SameBytes(Floats(a).values(), Floats(b).values())
                                                 : SameBytes(Ids(a).values(), Ids(b).values());
  return same_values && same_film(a.coverage, b.coverage) && same_film(a.lines, b.lines);
}

constexpr std::array kAllModes = {RenderMode::kShaded, RenderMode::kNormal, RenderMode::kDepth,
                                  RenderMode::kTriangle, RenderMode::kAmbientOcclusion};

// Looks at the origin from +z, `view_height` from top to bottom.
CameraSpec FromFront(double view_height) {
  return {.projection = Projection::kOrthographic,
          .eye = Vec3d{0, 0, 10},
          .target = Vec3d{},
          .view_height = view_height};
}

TEST(Renderer, ShadesASphereAsLambertSays) {
  const Scene scene = MakeScene(test::IcoSphere({0, 0, 0}, 1, 5));
  RenderSpec spec = {.width = 101, .height = 101, .camera = FromFront(2.02)};
  spec.color = {1, 0.5f, 0};
  const RenderedImage image = RenderOk(scene, spec);
  const float green = SrgbToLinear(0.5f);
  int on_sphere = 0;
  for (int y = 0; y < 101; ++y) {
    for (int x = 0; x < 101; ++x) {
      const std::span<const float> pixel = Floats(image)(x, y);
      const double r2 = (std::pow(x - 50, 2) + std::pow(y - 50, 2)) / 2500.0;
      if (r2 > 1.02) {
        ASSERT_EQ(std::vector<float>(pixel.begin(), pixel.end()), (std::vector<float>{1, 1, 1, 1}));
      } else if (r2 < 0.98) {
        // The normal of a flat triangle leans from the sphere's by up to its radius, some 0.03.
        ASSERT_NEAR(pixel[0], std::sqrt(1 - r2), 0.03) << x << ' ' << y;
        ASSERT_NEAR(pixel[1], green * pixel[0], 1e-6f);
        ASSERT_EQ(pixel[2], 0.0f);
        ASSERT_EQ(pixel[3], 1.0f);
        ++on_sphere;
      }
    }
  }
  EXPECT_GT(on_sphere, 7000);
}

TEST(Renderer, WritesNormalsInWorldAxes) {
  const Scene scene = MakeScene(test::Cube({0, 0, 0}, 1));
  struct Case {
    Vec3d eye, up, normal;
  };
  for (const Case& c : {Case{{9, 0, 0}, {0, 1, 0}, {1, 0, 0}},
                        {{0, -9, 0}, {0, 0, 1}, {0, -1, 0}},
                        {{0, 0, 9}, {1, 1, 0}, {0, 0, 1}}}) {
    RenderSpec spec = {.width = 8, .height = 8, .mode = RenderMode::kNormal};
    spec.camera = {.eye = c.eye, .target = Vec3d{}, .up = c.up, .fov_deg = 5.0};
    const RenderedImage image = RenderOk(scene, spec);
    for (int y = 0; y < 8; ++y) {
      for (int x = 0; x < 8; ++x) {
        const std::span<const float> n = Floats(image)(x, y);
        EXPECT_EQ((Vec3f{n[0], n[1], n[2]}), Vec3f(c.normal));
        for (const float x_y_or_z : n) EXPECT_FALSE(x_y_or_z == 0 && std::signbit(x_y_or_z));
        EXPECT_EQ((*image.coverage)(x, y)[0], 1.0f);
      }
    }
  }
}

TEST(Renderer, AveragesSamplesAtEdgesAndCountsCoverage) {
  // The cube's edge x = 0.5 halves column 12 of 16, one eighth of a unit a pixel.
  const Scene scene = MakeScene(test::Cube({-0.9375, 0, 0}, 1.5));
  RenderSpec spec = {.width = 16, .height = 16, .camera = FromFront(2)};
  spec.samples = 64;
  spec.background = Background{.transparent = true};
  const RenderedImage shaded = RenderOk(scene, spec);
  const Rgb color = SrgbToLinear(spec.color);
  spec.mode = RenderMode::kNormal;
  const RenderedImage normals = RenderOk(scene, spec);
  for (int y = 0; y < 16; ++y) {
    for (int x = 0; x < 16; ++x) {
      // 64 stratified samples meet an upright edge with the share of the filter before it, to one
      // of them; in the middle with exactly one half.
      const auto expected = static_cast<float>(PixelFilter::ShareBelow(12 - x));
      const std::span<const float> pixel = Floats(shaded)(x, y);
      ASSERT_NEAR(pixel[3], expected, x == 12 ? 0 : 1.0f / 64) << x << ' ' << y;
      const float share = pixel[3];
      ASSERT_NEAR(pixel[0], share * color.r, 1e-6f);
      ASSERT_NEAR(pixel[2], share * color.b, 1e-6f);
      ASSERT_NEAR(Floats(normals)(x, y)[2], share, 1e-6f);
      ASSERT_EQ((*normals.coverage)(x, y)[0], share);
    }
  }
}

TEST(Renderer, AnswersMissesAsTheContractSays) {
  const Scene scene = MakeScene(test::Cube({0, 0, 0}, 1));
  RenderSpec spec = {.width = 4, .height = 4};
  spec.camera = {.eye = Vec3d{0, 0, 9}, .target = Vec3d{0, 0, 99}};
  for (const RenderMode mode : kAllModes) {
    spec.mode = mode;
    const RenderedImage image = RenderOk(scene, spec);
    if (mode == RenderMode::kTriangle) {
      for (const std::int32_t id : Ids(image).values()) EXPECT_EQ(id, -1);
      continue;
    }
    const float expected = mode == RenderMode::kDepth    ? std::numeric_limits<float>::infinity()
                           : mode == RenderMode::kNormal ? 0.0f
                                                         : 1.0f;
    for (const float value : Floats(image).values()) EXPECT_EQ(value, expected);
  }
}

TEST(Renderer, MeasuresDepthAlongTheViewAxis) {
  // A wall across the view is equally deep everywhere, though its corners are farther away.
  const Scene scene = MakeScene(test::Cube({0, 0, 0}, 1));
  RenderSpec spec = {.width = 32, .height = 32, .mode = RenderMode::kDepth};
  spec.camera = {.eye = Vec3d{0, 0, 2}, .target = Vec3d{}, .fov_deg = 80.0};
  const RenderedImage image = RenderOk(scene, spec);
  for (const float depth : Floats(image).values()) EXPECT_EQ(depth, 1.0f);
}

TEST(Renderer, TakesOneSampleAtThePixelCentreForDepthAndTriangle) {
  const Scene scene = MakeScene(test::BumpySphere({0, 0, 0}, 1, 20, 30, 0.3));
  for (const RenderMode mode : {RenderMode::kDepth, RenderMode::kTriangle}) {
    RenderSpec spec = {.width = 64, .height = 48, .mode = mode};
    const RenderedImage one = RenderOk(scene, spec);
    spec.samples = 50;
    spec.seed = 9;
    EXPECT_TRUE(SameBytes(one, RenderOk(scene, spec)));
  }
}

// Everything that could make a pixel depend on its surroundings.
std::vector<RenderSpec> DemandingSpecs() {
  std::vector<RenderSpec> specs;
  for (const RenderMode mode : kAllModes) {
    for (const int samples : {1, 5}) {
      RenderSpec& spec = specs.emplace_back();
      spec.width = 150;
      spec.height = 110;
      spec.mode = mode;
      spec.samples = samples;
      spec.camera.projection = samples == 1 ? Projection::kOrthographic : Projection::kPerspective;
      spec.cells_depth = 5;
      spec.seed = 7;
    }
  }
  return specs;
}

template <class T>
void ExpectPart(const Film<T>& whole, const Film<T>& part) {
  const Region& r = part.region();
  for (int y = r.y0; y < r.y1; ++y) {
    for (int x = r.x0; x < r.x1; ++x) ASSERT_TRUE(SameBytes(part(x, y), whole(x, y)));
  }
}

TEST(Renderer, RegionsPutTogetherEqualTheWhole) {
  const Scene scene = MakeScene(test::BumpySphere({0, 0, 0}, 1, 20, 30, 0.3));
  for (RenderSpec spec : DemandingSpecs()) {
    const RenderedImage whole = RenderOk(scene, spec);
    for (const Region& region :
         {Region{0, 0, 71, 110}, {71, 0, 150, 33}, {71, 33, 150, 110}, {80, 50, 81, 51}}) {
      spec.region = region;
      const RenderedImage part = RenderOk(scene, spec);
      EXPECT_EQ(part.region(), region);
      if (spec.mode == RenderMode::kTriangle) {
        ExpectPart(Ids(whole), Ids(part));
      } else {
        ExpectPart(Floats(whole), Floats(part));
      }
      if (whole.coverage) ExpectPart(*whole.coverage, *part.coverage);
      if (whole.lines) ExpectPart(*whole.lines, *part.lines);
    }
  }
}

// An image that is rendered in one piece, and one whose regions alone can be. Of both, the pixels
// of a region are those of any other region that has them too.
TEST(Renderer, GivesTheSamePixelsInEveryRegionOfALargeImage) {
  const Scene scene = MakeScene(test::BumpySphere({0, 0, 0}, 1, 200, 300, 0.3));
  for (RenderSpec spec : DemandingSpecs()) {
    spec.width = 16384;
    spec.height = 8;
    spec.region.reset();
    const RenderedImage strip = RenderOk(scene, spec);
    spec.region = Region{8100, 2, 8300, 7};
    RenderedImage part = RenderOk(scene, spec);
    if (spec.mode == RenderMode::kTriangle) {
      ExpectPart(Ids(strip), Ids(part));
    } else {
      ExpectPart(Floats(strip), Floats(part));
    }

    spec.width = spec.height = RenderSpec::kMaxWholeSide;
    const int middle = spec.height / 2;
    spec.region = Region{middle - 8192, middle, middle + 8192, middle + 1};
    const RenderedImage row = RenderOk(scene, spec);
    spec.region = Region{middle - 50, middle - 1, middle + 50, middle + 2};
    part = RenderOk(scene, spec);
    spec.region = Region{middle - 50, middle, middle + 50, middle + 1};
    const RenderedImage smaller = RenderOk(scene, spec);
    if (spec.mode == RenderMode::kTriangle) {
      ExpectPart(Ids(row), Ids(smaller));
      ExpectPart(Ids(part), Ids(smaller));
    } else {
      ExpectPart(Floats(row), Floats(smaller));
      ExpectPart(Floats(part), Floats(smaller));
    }
    if (smaller.lines) ExpectPart(*row.lines, *smaller.lines);
  }
}

TEST(Renderer, HoldsMemoryForTheRegionAloneOfALargeImage) {
  const Scene scene = MakeScene(test::BumpySphere({0, 0, 0}, 1, 20, 30, 0.3));
  const auto peak_of = [&](int side) {
    const test::AllocationPeak peak;
    const int middle = side / 2;
    RenderOk(scene, {.width = side,
                     .height = side,
                     .region = Region{middle - 100, middle - 100, middle + 100, middle + 100}});
    return peak.bytes();
  };
  peak_of(200);  // What is made once.
  EXPECT_LE(peak_of(RenderSpec::kMaxWholeSide), peak_of(200) + (1 << 20));
}

TEST(Renderer, GivesTheSameBytesForAnyNumberOfThreads) {
  const Scene scene = MakeScene(test::BumpySphere({0, 0, 0}, 1, 20, 30, 0.3));
  for (const RenderSpec& spec : DemandingSpecs()) {
    std::vector<RenderedImage> images;
    for (const int threads : {1, 4}) {
      Arena(threads).Run([&] { images.push_back(RenderOk(scene, spec)); });
    }
    EXPECT_TRUE(SameBytes(images[0], images[1]));
  }
}

TEST(Renderer, GivesTheSameBytesForEveryBuild) {
  const MeshData mesh = test::BumpySphere({0, 0, 0}, 1, 20, 30, 0.3);
  std::vector<Scene> scenes;
  for (const BuildKind kind : kAllBuildKinds) scenes.push_back(MakeScene(mesh, kind));
  for (RenderSpec spec : DemandingSpecs()) {
    spec.cells_depth.reset();  // cells are the build's own
    spec.width /= 3;           // every ray tests every triangle of `box`
    spec.height /= 3;
    for (const Precision precision : kAllPrecisions) {
      spec.precision = precision;
      const RenderedImage expected = RenderOk(scenes[0], spec);
      for (const Scene& scene : scenes) {
        EXPECT_TRUE(SameBytes(expected, RenderOk(scene, spec))) << Name(scene.tree->build);
      }
    }
  }
}

TEST(Renderer, ScalesWithTheMeshToTheBit) {
  const MeshData mesh = test::RoundToFloat(test::BumpySphere({0.3, 0.2, 0.1}, 1, 20, 30, 0.3));
  for (const Projection projection : {Projection::kPerspective, Projection::kOrthographic}) {
    RenderSpec spec = {.width = 80, .height = 60};
    spec.camera.projection = projection;
    spec.mode = RenderMode::kDepth;
    const RenderedImage depth = RenderOk(MakeScene(mesh), spec);
    spec.mode = RenderMode::kTriangle;
    const RenderedImage ids = RenderOk(MakeScene(mesh), spec);
    for (const int exponent : {-100, -50, 10, 100}) {
      MeshData scaled = mesh;
      for (Vec3d& v : scaled.vertices) v = v * std::ldexp(1.0, exponent);
      const Scene scene = MakeScene(scaled);
      spec.mode = RenderMode::kTriangle;
      EXPECT_TRUE(SameBytes(ids, RenderOk(scene, spec)));
      spec.mode = RenderMode::kDepth;
      const RenderedImage scaled_depth = RenderOk(scene, spec);
      for (std::size_t i = 0; i < Floats(depth).values().size(); ++i) {
        ASSERT_EQ(Floats(scaled_depth).values()[i],
                  std::ldexp(Floats(depth).values()[i], exponent));
      }
    }
  }
}

TEST(Renderer, ShowsMeshesOfEverySizeAndPlace) {
  for (const double scale : {1e-30, 1e-15, 1.0, 1e15, 1e30}) {
    for (const double offset : {0.0, 1e5}) {
      const Vec3d center = Vec3d{1, -2, 3} * (scale * offset);
      const Scene scene = MakeScene(test::IcoSphere(center, scale, 3));
      for (const Projection projection : {Projection::kPerspective, Projection::kOrthographic}) {
        RenderSpec spec = {.width = 64, .height = 64};
        spec.camera.projection = projection;
        spec.background = Background{.transparent = true};
        spec.precision = AutoPrecision(*scene.mesh);
        spec.cells_depth = 3;
        double covered = 0;
        const RenderedImage image = RenderOk(scene, spec);
        for (std::size_t i = 0; i < Floats(image).values().size(); ++i) {
          const float value = Floats(image).values()[i];
          ASSERT_TRUE(value >= 0.0f && value <= 1.0f);
          if (i % 4 == 3) covered += static_cast<double>(value);
        }
        // A sphere in its framed box covers between a quarter and three quarters of the image.
        EXPECT_GT(covered / (64 * 64), 0.25) << scale << ' ' << offset;
        EXPECT_LT(covered / (64 * 64), 0.75) << scale << ' ' << offset;
      }
    }
  }
}

TEST(Renderer, ShowsFlatAndDegenerateMeshesWithoutNan) {
  MeshData line;
  line.vertices = {{0, 0, 0}, {1, 1, 1}, {2, 2, 2}};
  line.triangles = {{0, 1, 2}};
  MeshData point;
  point.vertices = {{5, 6, 7}};
  point.triangles = {{0, 0, 0}};
  for (const MeshData& mesh :
       {line, point, test::Grid(3, 0, 0.5), test::Grid(3, 1, 0), test::Grid(3, 2, -7)}) {
    const Scene scene = MakeScene(mesh);
    for (const RenderMode mode : {RenderMode::kShaded, RenderMode::kNormal, RenderMode::kDepth}) {
      RenderSpec spec = {.width = 20, .height = 20, .mode = mode, .samples = 4};
      spec.cells_depth = 2;
      const RenderedImage image = RenderOk(scene, spec);
      for (const float value : Floats(image).values()) {
        ASSERT_FALSE(std::isnan(value));
      }
    }
  }
}

TEST(Renderer, KeepsAHitDeeperThanFloatReachesAHit) {
  const Scene scene = MakeScene(test::Cube({0, 0, 0}, 1));
  RenderSpec spec = {.width = 2, .height = 2, .mode = RenderMode::kDepth};
  spec.camera = {.projection = Projection::kOrthographic,
                 .eye = Vec3d{0, 0, 1e39},
                 .target = Vec3d{},
                 .view_height = 1.0};
  const RenderedImage image = RenderOk(scene, spec);
  for (const float depth : Floats(image).values()) {
    EXPECT_EQ(depth, std::numeric_limits<float>::max());
  }
}

TEST(Renderer, PutsLinesIntoShadedValuesAndBesideOthers) {
  const Scene scene = MakeScene(test::IcoSphere({0, 0, 0}, 1, 3));
  for (const RenderMode mode : kAllModes) {
    RenderSpec spec = {.width = 64, .height = 64, .mode = mode};
    const RenderedImage plain = RenderOk(scene, spec);
    EXPECT_FALSE(plain.lines.has_value());
    spec.cells_depth = 2;
    const RenderedImage lined = RenderOk(scene, spec);
    if (mode == RenderMode::kShaded) {
      EXPECT_FALSE(SameBytes(Floats(plain).values(), Floats(lined).values()));
      EXPECT_FALSE(lined.lines.has_value());
    } else {
      ASSERT_TRUE(lined.lines.has_value());
      const std::span<const float> opacity = lined.lines->values();
      EXPECT_GT(*std::max_element(opacity.begin(), opacity.end()), 0.5f);
      EXPECT_TRUE(mode == RenderMode::kTriangle
                      ? SameBytes(Ids(plain).values(), Ids(lined).values())
                      : SameBytes(Floats(plain).values(), Floats(lined).values()));
    }
  }
}

TEST(Renderer, TellsTheCameraItUsed) {
  const Scene scene = MakeScene(test::Cube({0, 0, 0}, 1));
  const RenderedImage image = RenderOk(scene, {.width = 30, .height = 20});
  RenderSpec again = {.width = 30, .height = 20};
  again.camera = {.eye = image.camera.eye,
                  .target = image.camera.target,
                  .up = image.camera.up,
                  .fov_deg = image.camera.fov_deg};
  const RenderedImage same = RenderOk(scene, again);
  EXPECT_EQ(same.camera.eye, image.camera.eye);
  EXPECT_NEAR(Length(same.camera.forward - image.camera.forward), 0, 1e-15);
}

TEST(Renderer, RefusesWhatItCannotRender) {
  const Scene scene = MakeScene(test::Cube({0, 0, 0}, 1));
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  const auto expect_refusal = [&](std::string_view field, const RenderSpec& spec) {
    const Result<RenderedImage> image = Render(scene, spec);
    ASSERT_FALSE(image.ok()) << field;
    EXPECT_EQ(image.error().code, ErrorCode::kInvalidArgument);
    EXPECT_EQ(image.error().field, field);
  };
  expect_refusal("width", {.width = 0});
  expect_refusal("width", {.width = 1048577, .region = Region{0, 0, 1, 1}});
  expect_refusal("height", {.height = 0});
  expect_refusal("height", {.height = 1048577, .region = Region{0, 0, 1, 1}});
  expect_refusal("region", {.width = 16385, .height = 1});
  expect_refusal("region", {.width = 1, .height = 16385});
  expect_refusal("region", {.width = 1048576, .height = 1, .region = Region{5, 0, 16390, 1}});
  expect_refusal("samples", {.samples = 0});
  expect_refusal("samples", {.samples = 65537});
  expect_refusal("color", {.color = {0, 1.5f, 0}});
  expect_refusal("color", {.color = {0, kNan, 0}});
  expect_refusal("background", {.background = Background{.color = {-0.1f, 0, 0}}});
  expect_refusal("region", {.region = Region{-1, 0, 5, 5}});
  expect_refusal("region", {.region = Region{0, 0, 641, 5}});
  expect_refusal("region", {.region = Region{0, 0, 5, 481}});
  expect_refusal("region", {.region = Region{5, 0, 5, 5}});
  expect_refusal("region", {.region = Region{0, 6, 5, 5}});
  expect_refusal("up", {.camera = {.up = Vec3d{}}});
}

TEST(Renderer, TakesTheLargestAndSmallestOfEveryLimit) {
  const Scene scene = MakeScene(test::Cube({0, 0, 0}, 1));
  const Region corner = {0, 0, 1, 1};
  EXPECT_TRUE(Render(scene, {.width = 1048576, .height = 1048576, .region = corner}).ok());
  EXPECT_TRUE(Render(scene, {.width = 16384, .height = 1}).ok());
  EXPECT_TRUE(
      Render(scene, {.width = 1, .height = 1048576, .region = Region{0, 1032192, 1, 1048576}})
          .ok());
  EXPECT_TRUE(Render(scene, {.width = 1, .height = 1}).ok());
  EXPECT_TRUE(Render(scene, {.samples = 65536, .region = corner}).ok());
}

TEST(Renderer, RefusesMoreCellsThanAPictureCanShow) {
  const Scene scene = MakeScene(test::Soup(100000, 0.01, 1));
  const Result<RenderedImage> image = Render(scene, {.cells_depth = 40});
  ASSERT_FALSE(image.ok());
  EXPECT_EQ(image.error().code, ErrorCode::kInvalidArgument);
  EXPECT_EQ(image.error().field, "cells_depth");
}

TEST(Renderer, StopsWhenAskedAndAtItsDeadline) {
  const Scene scene = MakeScene(test::Cube({0, 0, 0}, 1));
  const CancelToken cancelled = CancelToken::Cancellable();
  cancelled.Cancel();
  EXPECT_EQ(Render(scene, {}, cancelled).error().code, ErrorCode::kCancelled);
  const CancelToken late = CancelToken::WithDeadline(CancelToken::Clock::now());
  EXPECT_EQ(Render(scene, {}, late).error().code, ErrorCode::kDeadlineExceeded);
}

TEST(Renderer, StopsWithinAQuarterSecondOfItsDeadline) {
  const Scene scene = MakeScene(test::IcoSphere({0, 0, 0}, 1, 4));
  using namespace std::chrono_literals;
  const auto start = CancelToken::Clock::now();
  const Result<RenderedImage> image = Render(scene, {.width = 2000, .height = 2000, .samples = 64},
                                             CancelToken::WithDeadline(start + 50ms));
  ASSERT_FALSE(image.ok());
  EXPECT_EQ(image.error().code, ErrorCode::kDeadlineExceeded);
  EXPECT_LT(CancelToken::Clock::now() - start, 300ms);
}

TEST(Renderer, ReportsProgressUpToOne) {
  const Scene scene = MakeScene(test::Cube({0, 0, 0}, 1));
  Progress progress;
  ASSERT_TRUE(Render(scene, {}, {}, &progress).ok());
  EXPECT_EQ(progress.fraction(), 1.0);
}

}  // namespace
}  // namespace kdray::core
