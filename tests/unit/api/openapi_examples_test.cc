// SPDX-License-Identifier: Apache-2.0
// The examples of openapi.yaml are what the code reads and writes.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "api/answer_codec.h"
#include "api/batch_codec.h"
#include "api/point_codec.h"
#include "api/request_codec.h"
#include "api/tree_id.h"
#include "api/visibility_codec.h"
#include "tests/unit/api/answers.h"
#include "tests/unit/api/openapi_json.h"

namespace kdray::api {
namespace {

const std::string kClosest = "/paths/~1v1~1trees~1{id}~1rays~1closest/post";
const std::string kAny = "/paths/~1v1~1trees~1{id}~1rays~1any/post";
const std::string kCount = "/paths/~1v1~1trees~1{id}~1rays~1count/post";
const std::string kAll = "/paths/~1v1~1trees~1{id}~1rays~1all/post";
const std::string kOkJson = "/responses/200/content/application~1json/examples/";

TEST(Examples, OfRequestsAreRead) {
  const auto rays = DecodeRays(
      Example("/components/requestBodies/Rays/content/application~1json/examples/square").dump(),
      BatchType::kJson, {}, Limits{});
  ASSERT_TRUE(rays) << rays.problem().detail;
  EXPECT_EQ(rays->size(), 4u);
  const auto render = DecodeRenderBody(
      Example("/components/requestBodies/Render/content/application~1json/examples/cells").dump(),
      ImageForm::kPng, "application/json", Limits{});
  ASSERT_TRUE(render) << render.problem().detail;
  EXPECT_EQ(render->cells_depth, 4);
  EXPECT_TRUE(render->transparent);
}

TEST(Examples, OfBatchAnswersAreWhatIsWritten) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  const RayTable rays = RaysOfShape({4});
  ClosestAnswer closest;
  closest.hits = {
      {1, 0.5, 0.25, 0}, {kInfinity, 0, 0, -1}, {2, 0.25, 0.5, 1}, {std::nan(""), 0, 0, -1}};
  closest.invalid = {3};
  EXPECT_EQ(json::parse(EncodeClosest(closest, rays, {}, BatchType::kJson)),
            Example(kClosest + kOkJson + "square"));
  EXPECT_EQ(json::parse(EncodeAny({1, 0, 1, 0}, {3}, rays, BatchType::kJson)),
            Example(kAny + kOkJson + "square"));
  EXPECT_EQ(json::parse(EncodeCount({1, 0, 1, 0}, {3}, rays, BatchType::kJson)),
            Example(kCount + kOkJson + "square"));
  BatchReport report;
  report.invalid = {3};
  EXPECT_EQ(json::parse(EncodeAll({{closest.hits[0]}, {}, {closest.hits[2]}, {}}, report, rays,
                                  BatchType::kJson)),
            Example(kAll + kOkJson + "square"));
}

TEST(Examples, OfPointQueriesAreReadAndWritten) {
  const auto points = DecodePoints(
      Example("/components/requestBodies/Points/content/application~1json/examples/square").dump(),
      BatchType::kJson, Limits{});
  ASSERT_TRUE(points) << points.problem().detail;
  const auto expect = [&](const char* path, const auto& rows) {
    const auto options = DecodeClosestPointOptions("", Limits{});
    ASSERT_TRUE(options) << options.problem().detail;
    PointWriter writer(*points, *options, BatchType::kJson);
    EXPECT_FALSE(writer.Put(std::span(rows)));
    EXPECT_EQ(json::parse(Join(std::move(writer).Finish({}))),
              Example("/paths/~1v1~1trees~1{id}~1points~1" + std::string(path) + "/post" + kOkJson +
                      "square"));
  };
  expect("closest", std::vector<NearestPoint>{{1, {0.75, 0.25, 0}, {}, 0.5, 0.25, 0},
                                              {5, {1, 1, 0}, {}, 0, 1, 0},
                                              {0, {0.5, 0.5, 0}, {}, 0, 0.5, 0}});
  expect("signed-distance", std::vector<double>{1, 5, 0});
  expect("inside", std::vector<std::int8_t>{0, 0, 1});
}

TEST(Examples, OfVisibilityAreReadAndWritten) {
  const std::string post = "/paths/~1v1~1trees~1{id}~1visibility/post";
  const auto sets = DecodePointSets(
      Example(post + "/requestBody/content/application~1json/examples/square").dump(),
      BatchType::kJson, {}, Limits{});
  ASSERT_TRUE(sets) << sets.problem().detail;
  VisibilityAnswer answer;
  answer.visible = {1, 1, 0, 1};
  EXPECT_EQ(json::parse(EncodeVisibility(answer, *sets, {}, BatchType::kJson)),
            Example(post + kOkJson + "square"));
}

TEST(Examples, OfDescriptionsAreWhatIsWritten) {
  const json ready = Example("/paths/~1v1~1trees~1{id}/get" + kOkJson + "ready");
  const json &mesh = ready["mesh"], &facts = ready["tree"];
  TreeDescription tree;
  tree.id = ready["id"];
  tree.ready = true;
  tree.progress = 1;
  tree.created_at = ready["created_at"];
  tree.mesh = {mesh["sha256"],
               MeshFormat::kObj,
               42,
               2,
               0,
               4,
               {{0, 0, 0}, {1, 1, 0}},
               {0, 0, 0, 4, 0, false, 0x1p-52},
               1,
               std::nullopt,
               std::vector<std::string>{}};
  tree.mesh_known = true;
  tree.tree = {Build::kBox, 1, 1, 0, 2, 0, {0, 0, 1}, 2, facts["bytes"], 4, 1, 4, 0.0625, 0.03125};
  tree.plan = ready["plan"];
  EXPECT_EQ(json::parse(EncodeDescription(tree)), ready);
  EXPECT_EQ(ParseTreeId(tree.id)->sha256, tree.mesh.sha256);

  const json building = Example("/paths/~1v1~1trees~1{id}/get" + kOkJson + "building");
  TreeDescription young;
  young.id = building["id"];
  young.progress = 0.25;
  young.created_at = building["created_at"];
  young.mesh.sha256 = mesh["sha256"];
  young.mesh.bytes = 42;
  EXPECT_EQ(json::parse(EncodeDescription(young)), building);
  EXPECT_EQ(json::parse(EncodePage({{young}, std::nullopt})),
            Example("/paths/~1v1~1trees/get" + kOkJson + "last"));
}

TEST(Examples, OfTradeoffsAreWhatIsWritten) {
  const std::string post = "/paths/~1v1~1trees~1{id}~1tradeoff/post/responses/";
  Tradeoff tradeoff;
  tradeoff.progress = 0.375;
  EXPECT_EQ(json::parse(EncodeTradeoff(tradeoff)),
            Example(post + "202/content/application~1json/examples/measuring"));
  tradeoff.ready = true;
  tradeoff.measured_at = "2024-05-17T09:31:00.500Z";
  tradeoff.triangles = 14160;
  tradeoff.closed = tradeoff.aimed_from_inside = true;
  tradeoff.threads = 8;
  tradeoff.load_average = 0.25;
  tradeoff.runs = 144;
  tradeoff.seed = 1;
  tradeoff.total_ms = 8250.5;
  TradeoffRow row;
  row.build = Build::kKdSah;
  row.precision = Precision::kWatertight;
  row.build_ms = 62.5;
  row.bytes = 524288;
  row.sah_cost = 40.5;
  row.random = {8e6, 7.5e6, 8.25e6, 21.5, 4.75};
  row.aimed = {7e6, 6.5e6, 7.25e6, 18.25, 6.5};
  row.leaks = ErrorRate{0, 60000};
  row.wrong_triangles = {30000, 60000};
  row.unconnected_triangles = row.folds = row.missed_hits = row.extra_hits =
      row.differences = {0, 60000};
  row.t_error_rays = 60000;
  row.t_error_p999 = 1.25e-8;
  row.t_error_max = 4e-8;
  row.t_error_bound = 1e-6;
  tradeoff.results = {row};
  EXPECT_EQ(json::parse(EncodeTradeoff(tradeoff)),
            Example(post + "200/content/application~1json/examples/sphere"));
}

TEST(Examples, OfTheOtherAnswersAreWhatIsWritten) {
  EXPECT_EQ(json::parse(EncodeCapabilities(KDRAY_VERSION, Limits{})),
            Example("/paths/~1v1/get" + kOkJson + "defaults"));
  EXPECT_EQ(json::parse(EncodeCells({{{{0, 0, 0}, {1, 1, 0}}, 0, true, 2}})),
            Example("/paths/~1v1~1trees~1{id}~1cells/get" + kOkJson + "square"));
  const json problem =
      Example("/components/responses/Problem/content/application~1problem+json/examples/typo");
  const auto refused = DecodeRenderQuery("samples=5000", ImageForm::kPng, Limits{});
  ASSERT_FALSE(refused);
  EXPECT_EQ(json::parse(EncodeProblem(refused.problem(), problem["request_id"].get<std::string>())),
            problem);
}

}  // namespace
}  // namespace kdray::api
