// SPDX-License-Identifier: Apache-2.0
#include "server/mapping.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "api/names.h"
#include "server/plan.h"
#include "tests/support/scenes.h"
#include "tests/support/shapes.h"

namespace kdray::server {
namespace {

using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;

core::TreeRecord ReadyRecord() {
  core::TreeRecord record;
  record.created_ms = 1'700'000'000'123;
  record.mesh_bytes = 4711;
  core::MeshFacts mesh;
  mesh.format = core::MeshFormat::kPly;
  mesh.file_bytes = 4711;
  mesh.triangles = 100;
  mesh.dropped = 2;
  mesh.vertices = 60;
  mesh.bounds = {{-1, -2, -3}, {1, 2, 3}};
  mesh.health = {1, 2, 3, 4, 5, false, 0.5};
  mesh.shortest_edge = 0.01;
  mesh.parse_ms = 1.5;
  record.mesh = mesh;
  core::TreeFacts tree;
  tree.build = core::BuildKind::kKdSah;
  tree.stats.nodes = 7;
  tree.stats.leaves = 4;
  tree.stats.empty_leaves = 1;
  tree.stats.references = 120;
  tree.stats.max_depth = 3;
  tree.stats.leaf_histogram = {1, 0, 3};
  tree.stats.max_leaf = 2;
  tree.stats.bytes = 999;
  tree.stats.sah_cost = 12.5;
  tree.stats.traversal_cost = 1;
  tree.stats.intersection_cost = 2;
  tree.build_ms = 2.5;
  record.tree = tree;
  return record;
}

TEST(Mapping, EveryErrorOfCoreHasItsCode) {
  using core::ErrorCode;
  const std::pair<ErrorCode, api::ErrorCode> table[] = {
      {ErrorCode::kInvalidMesh, api::ErrorCode::kInvalidMesh},
      {ErrorCode::kEmptyMesh, api::ErrorCode::kEmptyMesh},
      {ErrorCode::kUnsupportedMeshFormat, api::ErrorCode::kUnsupportedMeshFormat},
      {ErrorCode::kMeshTooLarge, api::ErrorCode::kMeshTooLarge},
      {ErrorCode::kInvalidArgument, api::ErrorCode::kInvalidParameter},
      {ErrorCode::kNotFound, api::ErrorCode::kMeshNotFound},
      {ErrorCode::kCancelled, api::ErrorCode::kDraining},
      {ErrorCode::kDeadlineExceeded, api::ErrorCode::kDeadlineExceeded},
      {ErrorCode::kMemoryFull, api::ErrorCode::kMemoryFull},
      {ErrorCode::kStoreFull, api::ErrorCode::kStoreFull},
      {ErrorCode::kCorrupt, api::ErrorCode::kInternal},
      {ErrorCode::kIo, api::ErrorCode::kInternal},
      {ErrorCode::kInternal, api::ErrorCode::kInternal},
  };
  for (const auto& [from, to] : table) {
    const api::Problem problem = ToProblem({from, "a cause"}, api::ErrorCode::kMeshNotFound);
    EXPECT_EQ(problem.code, to) << static_cast<int>(from);
    EXPECT_FALSE(problem.detail.empty());
  }
}

TEST(Mapping, AProblemSaysLineAndFieldAndNothingInternal) {
  core::Error error{core::ErrorCode::kInvalidMesh, "line 7: no such vertex"};
  error.line = 7;
  EXPECT_EQ(ToProblem(error).line, 7u);
  EXPECT_EQ(ToProblem(error).detail, "line 7: no such vertex");
  const api::Problem field = ToProblem({.code = core::ErrorCode::kInvalidArgument,
                                        .message = "must be below 180",
                                        .field = "fov_deg"});
  EXPECT_EQ(field.parameter, "fov_deg");
  EXPECT_EQ(field.detail, "fov_deg: must be below 180");
  const api::Problem no_field =
      ToProblem({core::ErrorCode::kInvalidArgument, "depth: of a text, which names no field"});
  EXPECT_EQ(no_field.parameter, std::nullopt);
  EXPECT_THAT(ToProblem({core::ErrorCode::kIo, "disk sda has a secret"}).detail,
              Not(HasSubstr("secret")));
}

TEST(Mapping, BuildsAndPrecisionsGoBothWays) {
  EXPECT_EQ(ToCore(api::Build::kAuto), std::nullopt);
  for (const core::BuildKind build : core::kAllBuildKinds) {
    EXPECT_EQ(ToCore(ToApi(build)), build);
    EXPECT_EQ(api::Name(ToApi(build)), core::Name(build));
  }
  for (const core::Precision precision : core::kAllPrecisions) {
    EXPECT_EQ(ToCore(ToApi(precision), core::Precision::kFast), precision);
    EXPECT_EQ(api::Name(ToApi(precision)), core::Name(precision));
    EXPECT_EQ(ToCore(api::Precision::kAuto, precision), precision);
  }
}

TEST(Mapping, ACursorComesBackAsItWasAndNothingElseIsOne) {
  core::TreeInfo info;
  info.record = ReadyRecord();
  info.record.id.build = core::BuildKind::kKdBinned;
  const std::string cursor = FormatCursor(info);
  const auto position = ParseCursor(cursor);
  ASSERT_TRUE(position.has_value());
  EXPECT_EQ(position->created_ms, info.record.created_ms);
  EXPECT_EQ(position->id, info.record.id);
  for (const std::string& bad :
       {std::string("x"), std::string("."), "1." + std::string(64, '0'), cursor + "x",
        cursor.substr(1, 5), " " + cursor, "99999999999999999999" + cursor.substr(13)}) {
    EXPECT_FALSE(ParseCursor(bad).has_value()) << bad;
  }
}

TEST(Mapping, ADescriptionTellsAllFacts) {
  core::TreeInfo info;
  info.record = ReadyRecord();
  info.progress = 1;
  const api::TreeDescription d = ToApi(info);
  EXPECT_EQ(d.id, std::string(64, '0') + "-auto");
  EXPECT_TRUE(d.ready && d.mesh_known && d.tree.has_value());
  EXPECT_EQ(d.created_at, "2023-11-14T22:13:20.123Z");
  EXPECT_EQ(d.mesh.sha256, std::string(64, '0'));
  EXPECT_EQ(d.mesh.format, api::MeshFormat::kPly);
  EXPECT_EQ(d.mesh.bytes, 4711u);
  EXPECT_EQ(d.mesh.triangles, 100u);
  EXPECT_EQ(d.mesh.dropped, 2u);
  EXPECT_EQ(d.mesh.vertices, 60u);
  EXPECT_EQ(d.mesh.bounds.min, (api::Vec3{-1, -2, -3}));
  EXPECT_EQ(d.mesh.bounds.max, (api::Vec3{1, 2, 3}));
  EXPECT_EQ(d.mesh.health.degenerate, 1u);
  EXPECT_EQ(d.mesh.health.duplicate, 2u);
  EXPECT_EQ(d.mesh.health.concave, 3u);
  EXPECT_EQ(d.mesh.health.open_edges, 4u);
  EXPECT_EQ(d.mesh.health.non_manifold_edges, 5u);
  EXPECT_FALSE(d.mesh.health.closed);
  EXPECT_EQ(d.mesh.health.coordinate_resolution, 0.5);
  EXPECT_EQ(d.tree->build, api::Build::kKdSah);
  EXPECT_EQ(d.tree->nodes, 7u);
  EXPECT_EQ(d.tree->leaves, 4u);
  EXPECT_EQ(d.tree->empty_leaves, 1u);
  EXPECT_EQ(d.tree->references, 120u);
  EXPECT_EQ(d.tree->max_depth, 3u);
  EXPECT_EQ(d.tree->leaf_histogram, (std::vector<std::uint64_t>{1, 0, 3}));
  EXPECT_EQ(d.tree->max_leaf, 2u);
  EXPECT_EQ(d.tree->bytes, 999u);
  EXPECT_EQ(d.tree->sah_cost, 12.5);
  EXPECT_EQ(d.tree->traversal_cost, 1);
  EXPECT_EQ(d.tree->intersection_cost, 2);
  EXPECT_EQ(d.tree->parse_ms, 1.5);
  EXPECT_EQ(d.tree->build_ms, 2.5);
}

TEST(Mapping, ADescriptionOfATreeThatIsBuiltTellsWhatIsKnown) {
  core::TreeInfo info;
  info.record = ReadyRecord();
  info.record.mesh.reset();
  info.record.tree.reset();
  info.progress = 0.25;
  const api::TreeDescription d = ToApi(info);
  EXPECT_FALSE(d.ready || d.mesh_known || d.tree.has_value());
  EXPECT_EQ(d.progress, 0.25);
  EXPECT_EQ(d.mesh.bytes, 4711u);
  EXPECT_EQ(d.mesh.sha256, std::string(64, '0'));
}

TEST(Plan, SaysStructureVerticesPrecisionAndWhatIsNotPromised) {
  core::TreeRecord record = ReadyRecord();
  std::string plan = DescribePlan(record);
  EXPECT_THAT(plan, HasSubstr("kd-tree"));
  EXPECT_THAT(plan, HasSubstr("the choice of auto for 100 triangles"));
  EXPECT_THAT(plan, HasSubstr("floats (12 bytes)"));
  EXPECT_THAT(plan, HasSubstr("auto means watertight"));
  EXPECT_THAT(plan, HasSubstr("4 open and 5 non-manifold"));
  EXPECT_THAT(plan, HasSubstr("watertightness is not guaranteed"));

  record.id.build = core::BuildKind::kBvh;
  record.mesh->health.closed = true;
  record.mesh->double_vertices = true;
  record.mesh->frame = {{148376, 0, -0.5}, 1};
  plan = DescribePlan(record);
  EXPECT_THAT(plan, HasSubstr("bounding volume hierarchy"));
  EXPECT_THAT(plan, HasSubstr("bvh, as asked"));
  EXPECT_THAT(plan, HasSubstr("doubles (24 bytes)"));
  EXPECT_THAT(plan, HasSubstr("(148376, 0, -0.5)"));
  EXPECT_THAT(plan, HasSubstr("auto means double"));
  EXPECT_THAT(
      plan, HasSubstr("With watertight and fast, rays are answered on vertices rounded to float"));
  EXPECT_THAT(plan, HasSubstr("The mesh is closed"));

  EXPECT_THAT(plan, Not(HasSubstr("calls its coordinates floats")));
  record.mesh->wider_than_declared = true;
  EXPECT_THAT(
      DescribePlan(record),
      HasSubstr("The file calls its coordinates floats, but writes numbers with more digits "
                "than floats have; they are read as doubles."));
  record.mesh->wider_than_declared = false;
  EXPECT_THAT(plan, Not(HasSubstr("small beside the largest")));
  record.mesh->rounded_vertices = true;
  EXPECT_THAT(DescribePlan(record),
              HasSubstr("small beside the largest that they are rounded, by up to 2^-1074"));
  record.mesh->rounded_vertices = false;

  record.mesh->double_vertices = false;
  record.mesh->shortest_edge = 1e-9;
  EXPECT_THAT(DescribePlan(record), HasSubstr("auto means double: the shortest edges"));

  record.id.build.reset();
  record.mesh->triangles = 12;
  record.tree->build = core::BuildKind::kBox;
  EXPECT_THAT(DescribePlan(record), HasSubstr("12 triangles need no tree"));
  record.tree.reset();
  EXPECT_THAT(DescribePlan(record), HasSubstr("12 triangles need no tree"));
  record.mesh.reset();
  EXPECT_EQ(DescribePlan(record), "The mesh is being read.");
}

TEST(Mapping, ThePlanTellsWhatAutoChoseAndWhy) {
  core::TreeRecord record = ReadyRecord();
  record.id.build.reset();
  const auto expect_start = [&](const std::string& start) {
    EXPECT_THAT(DescribePlan(record), StartsWith(start + ". Vertices"));
  };
  record.choice = {12.34, core::AutoChoice::Costs{20.26, 10.04}};
  expect_start(
      "A kd-tree by the surface area heuristic, with clipped triangles (kd-sah), the choice of "
      "auto for 100 triangles: a random line is expected to meet 10.0 of its nodes and blocks of "
      "triangles, and 20.3 with bvh; each takes up to a third longer in kd-sah");
  record.tree->build = core::BuildKind::kBvh;
  record.choice->costs = {9.96, 11};
  expect_start(
      "A bounding volume hierarchy by the binned surface area heuristic (bvh), the choice of auto "
      "for 100 triangles: a random line is expected to meet 10.0 of its nodes and blocks of "
      "triangles, and 11.0 with kd-sah; each takes up to a third longer in kd-sah");
  record.choice->costs.reset();
  record.choice->overlap = 2;
  expect_start(
      "A bounding volume hierarchy by the binned surface area heuristic (bvh), the choice of auto "
      "for 100 triangles: the boxes of its triangles overlap so little (a random line meets 2.0 of "
      "them) that kd-sah was not tried");
  record.choice.reset();
  record.tree->build = core::BuildKind::kKdSah;
  expect_start(
      "A kd-tree by the surface area heuristic, with clipped triangles (kd-sah), the choice of "
      "auto for 100 triangles in an older version");
  record.tree.reset();
  expect_start("Build auto means bvh or kd-sah for 100 triangles: it is being chosen");
}

TEST(Mapping, ARenderRequestKeepsItsFields) {
  api::RenderRequest request;
  request.width = 12;
  request.height = 34;
  request.eye = api::Vec3{1, 2, 3};
  request.up = api::Vec3{0, 0, 1};
  request.fov_deg = 50;
  request.mode = api::RenderMode::kDepth;
  request.samples = 4;
  request.color = api::Vec3{0.5, 0.25, 1};
  request.transparent = true;
  request.cells_depth = 3;
  request.region = api::Region{1, 2, 3, 4};
  request.seed = 99;
  request.lights.emplace(2);
  request.lights->at(0).direction = api::Vec3{1, 2, 3};
  request.lights->at(0).intensity = 4;
  request.lights->at(0).color = {1, 0.5, 0};
  request.lights->at(1).position = api::Vec3{5, 6, 7};
  request.shadows = true;
  request.ao_radius = 8;
  request.precision = api::Precision::kDouble;
  core::RenderSpec spec = ToCore(request);
  EXPECT_EQ(spec.width, 12);
  EXPECT_EQ(spec.height, 34);
  EXPECT_EQ(spec.camera.projection, core::Projection::kPerspective);
  EXPECT_EQ(spec.camera.eye, (core::Vec3d{1, 2, 3}));
  EXPECT_EQ(spec.camera.target, std::nullopt);
  EXPECT_EQ(spec.camera.up, (core::Vec3d{0, 0, 1}));
  EXPECT_EQ(spec.camera.fov_deg, 50);
  EXPECT_EQ(spec.mode, core::RenderMode::kDepth);
  EXPECT_EQ(spec.samples, 4);
  EXPECT_EQ(spec.precision, core::Precision::kDouble);
  EXPECT_EQ(spec.color, (core::Rgb{0.5f, 0.25f, 1}));
  ASSERT_TRUE(spec.background.has_value());
  EXPECT_TRUE(spec.background->transparent);
  EXPECT_EQ(spec.cells_depth, 3u);
  EXPECT_EQ(spec.region, (core::Region{1, 2, 3, 4}));
  EXPECT_EQ(spec.seed, 99u);
  ASSERT_EQ(spec.lights->size(), 2u);
  EXPECT_EQ(spec.lights->at(0).kind, core::LightKind::kDirectional);
  EXPECT_EQ(spec.lights->at(0).vector, (core::Vec3d{1, 2, 3}));
  EXPECT_EQ(spec.lights->at(0).intensity, 4);
  EXPECT_EQ(spec.lights->at(0).color, (core::Rgb{1, 0.5f, 0}));
  EXPECT_EQ(spec.lights->at(1).kind, core::LightKind::kPoint);
  EXPECT_EQ(spec.lights->at(1).vector, (core::Vec3d{5, 6, 7}));
  EXPECT_TRUE(spec.shadows);
  EXPECT_EQ(spec.ao_radius, 8);

  request.projection = api::Projection::kOrthographic;
  request.view_height = 7;
  spec = ToCore(request);
  EXPECT_EQ(spec.camera.projection, core::Projection::kOrthographic);
  EXPECT_EQ(spec.camera.fov_deg, std::nullopt) << "has a default, but belongs to perspective";
  EXPECT_EQ(spec.camera.view_height, 7);

  request.projection = api::Projection::kSpherical;
  request.h_fov_deg = 90;
  request.precision = api::Precision::kAuto;
  spec = ToCore(request);
  EXPECT_EQ(spec.camera.projection, core::Projection::kSpherical);
  EXPECT_EQ(spec.camera.h_fov_deg, 90);
  EXPECT_EQ(spec.camera.v_fov_deg, 180);
  EXPECT_EQ(spec.precision, std::nullopt) << "the picture decides";

  request = {};
  request.view = api::View::kTop;
  request.intrinsic = {1, 2, 3, 4};
  request.extrinsic = {1, 0, 0, 5, 0, 1, 0, 6, 0, 0, 1, 7, 0, 0, 0, 1};
  spec = ToCore(request);
  EXPECT_EQ(spec.camera.view, core::View::kTop);
  EXPECT_EQ(spec.camera.intrinsic->fx, 1);
  EXPECT_EQ(spec.camera.intrinsic->fy, 2);
  EXPECT_EQ(spec.camera.intrinsic->cx, 3);
  EXPECT_EQ(spec.camera.intrinsic->cy, 4);
  EXPECT_EQ(spec.camera.extrinsic, request.extrinsic);
}

TEST(Mapping, TheDefaultsOfTheContractAreThoseOfCore) {
  const core::RenderSpec spec = ToCore(api::RenderRequest{});
  const core::RenderSpec core_spec;
  EXPECT_EQ(spec.width, core_spec.width);
  EXPECT_EQ(spec.height, core_spec.height);
  EXPECT_EQ(spec.samples, std::nullopt);
  EXPECT_EQ(spec.lights, std::nullopt);
  EXPECT_EQ(spec.shadows, core_spec.shadows);
  EXPECT_EQ(spec.ao_radius, core_spec.ao_radius);
  EXPECT_EQ(spec.max_samples, core_spec.max_samples);
  EXPECT_EQ(spec.color, core_spec.color);
  EXPECT_EQ(spec.seed, core_spec.seed);
  EXPECT_EQ(spec.mode, core_spec.mode);
  EXPECT_EQ(spec.camera.projection, core_spec.camera.projection);
  EXPECT_EQ(spec.camera.fov_deg, core::kDefaultFovDeg);
  EXPECT_FALSE(spec.background);

  const core::Scene scene = test::MakeScene(test::Cube({0, 0, 0}, 1));
  for (std::size_t mode = 0; mode < api::kRenderModeNames.size(); ++mode) {
    api::RenderRequest request;
    request.width = request.height = 4;
    request.mode = static_cast<api::RenderMode>(mode);
    const auto image = core::Render(scene, ToCore(request));
    ASSERT_TRUE(image.ok());
    const api::Vec3 background = api::DefaultBackground(request.mode);
    EXPECT_EQ(image->background.color.r, static_cast<float>(background[0]));
    EXPECT_EQ(image->background.color.g, static_cast<float>(background[1]));
    EXPECT_EQ(image->background.color.b, static_cast<float>(background[2]));
    EXPECT_FALSE(image->background.transparent);
  }
}

TEST(Mapping, ACameraValueThatIsLeftOutStaysLeftOut) {
  const core::RenderSpec spec = ToCore(api::RenderRequest{});
  EXPECT_EQ(spec.camera.eye, std::nullopt);
  EXPECT_EQ(spec.camera.target, std::nullopt);
  EXPECT_EQ(spec.camera.up, std::nullopt);
  EXPECT_EQ(spec.camera.view_height, std::nullopt);
}

}  // namespace
}  // namespace kdray::server
