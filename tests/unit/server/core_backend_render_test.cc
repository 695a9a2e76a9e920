// SPDX-License-Identifier: Apache-2.0
// The backend's pictures, arrays and cells.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstring>
#include <string>
#include <variant>
#include <vector>

#include "tests/unit/server/core_backend_fixture.h"

namespace kdray::server {
namespace {

using api::ErrorCode;
using std::chrono::steady_clock;

TEST_F(CoreBackendTest, RendersAPngAndArrays) {
  const std::string id = Add(Sphere());
  api::RenderRequest request;
  request.width = 40;
  request.height = 30;
  const auto png = Render(id, request, true, Soon());
  ASSERT_TRUE(png.ok());
  const auto& bytes = std::get<std::vector<std::byte>>(png->image);
  ASSERT_GT(bytes.size(), 8u);
  EXPECT_EQ(std::to_integer<int>(bytes[1]), 'P');
  EXPECT_GT(png->trace_ms, 0);
  EXPECT_GT(png->encode_ms, 0);
  const std::pair<api::RenderMode, std::size_t> channels[] = {
      {api::RenderMode::kShaded, 4}, {api::RenderMode::kNormal, 3},
      {api::RenderMode::kDepth, 1},  {api::RenderMode::kTriangle, 1},
      {api::RenderMode::kCost, 2},   {api::RenderMode::kPosition, 3}};
  for (const auto& [mode, count] : channels) {
    request.mode = mode;
    const auto array = Render(id, request, false, Soon());
    ASSERT_TRUE(array.ok());
    const auto& image = std::get<api::ImageArray>(array->image);
    EXPECT_EQ(image.width, 40u);
    EXPECT_EQ(image.height, 30u);
    EXPECT_EQ(image.channels, count);
    std::visit([&](const auto& values) { EXPECT_EQ(values.size(), 40u * 30u * count); },
               image.values);
    const bool is_integer = mode == api::RenderMode::kTriangle || mode == api::RenderMode::kCost;
    const bool is_double = mode == api::RenderMode::kPosition;
    EXPECT_EQ(image.values.index(), is_integer ? 1u : is_double ? 2u : 0u);
  }
}

TEST_F(CoreBackendTest, EdgesOfAPolygonAreDrawnWithoutItsDiagonals) {
  const auto light_at = [&](std::string_view faces, int x, int y) {
    const std::string off = "OFF\n4 " + std::string(faces.size() > 10 ? "2" : "1") +
                            " 0\n-1 -1 0\n1 -1 0\n1 1 0\n-1 1 0\n" + std::string(faces);
    MeshBytesVector bytes(off.size());
    std::memcpy(bytes.data(), off.data(), off.size());
    const auto stored = Upload(bytes, api::Build::kAuto);
    EXPECT_TRUE(stored.ok());
    EXPECT_TRUE(
        backend_->Describe(stored->id, steady_clock::now() + std::chrono::minutes(1), {}).ok());
    api::RenderRequest request;
    request.width = request.height = 41;
    request.projection = api::Projection::kOrthographic;
    request.view = api::View::kFront;
    request.edges = true;
    const auto array = Render(stored->id, request, false, Soon());
    EXPECT_TRUE(array.ok()) << array.problem().detail;
    const auto& image = std::get<api::ImageArray>(array->image);
    return std::get<std::vector<float>>(image.values)[static_cast<std::size_t>(4 * (41 * y + x))];
  };
  const std::string_view polygon = "4 0 1 2 3\n", triangles = "3 0 1 2\n3 0 2 3\n";
  EXPECT_LT(light_at(triangles, 20, 20), 0.5F * light_at(polygon, 20, 20)) << "the diagonal";
  EXPECT_EQ(light_at(triangles, 10, 20), light_at(polygon, 10, 20)) << "beside it";
  EXPECT_EQ(backend_->counters().attribute_reads, 2u) << "once for each file";
}

TEST_F(CoreBackendTest, ColoursAndNormalsOfTheFileAreUsedWhereTheyAreNamed) {
  // Red vertices, whose normals are turned by 60 degrees from the triangle's own.
  const std::string obj =
      "v -1 -1 0 1 0 0\nv 1 -1 0 1 0 0\nv 0 1 0 1 0 0\nvn 0.8660254037844386 0 0.5\n"
      "f 1//1 2//1 3//1\n";
  MeshBytesVector bytes(obj.size());
  std::memcpy(bytes.data(), obj.data(), obj.size());
  const auto stored = Upload(bytes, api::Build::kAuto);
  ASSERT_TRUE(stored.ok());
  ASSERT_TRUE(
      backend_->Describe(stored->id, steady_clock::now() + std::chrono::minutes(1), {}).ok());
  api::RenderRequest request;
  request.width = request.height = 21;
  request.projection = api::Projection::kOrthographic;
  request.view = api::View::kFront;
  request.color = {1, 1, 1};
  const auto middle = [&] {
    const auto array = Render(stored->id, request, false, Soon());
    EXPECT_TRUE(array.ok()) << array.problem().detail;
    const auto& values =
        std::get<std::vector<float>>(std::get<api::ImageArray>(array->image).values);
    const float* pixel = values.data() + std::size_t{4} * (21 * 10 + 10);
    return std::array<float, 3>{pixel[0], pixel[1], pixel[2]};
  };
  const auto plain = middle();
  EXPECT_EQ(backend_->counters().attribute_reads, 0u);
  request.smooth = true;
  const auto smooth = middle();
  request.file_color = true;
  const auto red = middle();
  EXPECT_EQ(plain[0], plain[1]);
  EXPECT_NEAR(smooth[0], 0.5F * plain[0], 1e-3F) << "the cosine of 60 degrees";
  EXPECT_NEAR(red[0], smooth[0], 1e-3F);
  EXPECT_EQ(red[1], 0.0F);
  EXPECT_EQ(red[2], 0.0F);
}

TEST_F(CoreBackendTest, RegionsOfADepthPictureHaveTheRangeOfTheWhole) {
  const std::string id = Add(Sphere());
  api::RenderRequest request;
  request.width = 40;
  request.height = 30;
  request.mode = api::RenderMode::kDepth;
  const auto array = Render(id, request, false, Soon());
  ASSERT_TRUE(array.ok());
  EXPECT_FALSE(array->depth_range) << "an array has no greys";
  double near = HUGE_VAL, far = 0;
  for (const float depth :
       std::get<std::vector<float>>(std::get<api::ImageArray>(array->image).values)) {
    if (std::isinf(depth)) continue;
    near = std::min(near, static_cast<double>(depth));
    far = std::max(far, static_cast<double>(depth));
  }
  using Range = std::array<double, 2>;
  EXPECT_EQ(Render(id, request, true, Soon())->depth_range, (Range{near, far}));
  request.region = api::Region{18, 12, 22, 16};
  EXPECT_EQ(Render(id, request, true, Soon())->depth_range, (Range{near, far}));
  request.depth_range = {1, 2};
  EXPECT_EQ(Render(id, request, true, Soon())->depth_range, (Range{1, 2}));
  request.depth_range.reset();
  request.eye = api::Vec3{1, 2, 99};
  request.target = api::Vec3{1, 2, 199};
  EXPECT_EQ(Render(id, request, true, Soon())->depth_range, std::nullopt) << "nothing is hit";
}

TEST_F(CoreBackendTest, ACameraThatCannotBeIsAnInvalidParameter) {
  const std::string id = Add(Sphere());
  api::RenderRequest request;
  request.eye = api::Vec3{1, 2, 3};
  request.target = api::Vec3{1, 2, 3};
  const auto answer = Render(id, request, true, Soon());
  ASSERT_FALSE(answer.ok());
  EXPECT_EQ(answer.problem().code, ErrorCode::kInvalidParameter);
  EXPECT_TRUE(answer.problem().parameter.has_value()) << answer.problem().detail;
}

TEST_F(CoreBackendTest, CellsAreInWorldUnitsAndLimited) {
  const std::string id = Add(Sphere());
  const auto root = Cells(id, 0, Soon());
  ASSERT_TRUE(root.ok());
  ASSERT_EQ(root->size(), 1u);
  const auto description = DescribeNow(id);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    EXPECT_NEAR((*root)[0].bounds.min[axis], description->mesh.bounds.min[axis], 1e-5);
    EXPECT_NEAR((*root)[0].bounds.max[axis], description->mesh.bounds.max[axis], 1e-5);
  }
  EXPECT_FALSE((*root)[0].leaf);
  options_.limits.max_cells = 10;
  Open();
  EXPECT_LE(Cells(id, 3, Soon())->size(), 8u);
  const auto many = Cells(id, 10, Soon());
  ASSERT_FALSE(many.ok());
  EXPECT_EQ(many.problem().code, ErrorCode::kTooManyCells);
  EXPECT_EQ(many.problem().limit, 10.0);
}

TEST_F(CoreBackendTest, APictureOfTooManyCellsSaysSoAndHowManyItDraws) {
  options_.limits.max_picture_cells = 8;
  Open();
  const std::string id = Add(Sphere());
  api::RenderRequest request;
  request.width = request.height = 8;
  request.cells_depth = 3;
  EXPECT_TRUE(Render(id, request, true, Soon()).ok());
  EXPECT_EQ(backend_->counters().binary_rebuilds, 1u);
  EXPECT_TRUE(Cells(id, 3, Soon()).ok());
  EXPECT_EQ(backend_->counters().binary_rebuilds, 1u) << "pictures and lists share it";
  request.cells_depth = 10;
  const auto many = Render(id, request, true, Soon());
  ASSERT_FALSE(many.ok());
  EXPECT_EQ(many.problem().code, ErrorCode::kTooManyCells);
  EXPECT_EQ(many.problem().parameter, "cells_depth");
  EXPECT_EQ(many.problem().limit, 8.0);
}

}  // namespace
}  // namespace kdray::server
