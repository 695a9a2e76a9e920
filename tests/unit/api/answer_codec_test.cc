// SPDX-License-Identifier: Apache-2.0
#include "api/answer_codec.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <string>

namespace kdray::api {
namespace {

using nlohmann::json;

TEST(Problems, CarryCodeStatusTitleAndRequest) {
  EXPECT_EQ(json::parse(EncodeProblem({ErrorCode::kTreeNotFound, "no tree has this id"}, "r-1")),
            json::parse(R"({"type":"/problems/tree_not_found","title":"No tree has this id",
                            "status":404,"detail":"no tree has this id","code":"tree_not_found",
                            "request_id":"r-1"})"));
}

TEST(Problems, CarryWhatHelpsAsPlainNumbers) {
  Problem problem{ErrorCode::kTooManyRays, "too many", "/rays"};
  problem.limit = 4000000;
  problem.actual = 4000000.5;
  problem.line = 17;
  const std::string text = EncodeProblem(problem, "r");
  EXPECT_THAT(text, testing::HasSubstr(
                        R"("parameter":"/rays","limit":4000000,"actual":4000000.5,"line":17})"));
}

TEST(Problems, AreAlwaysValidJson) {
  Problem problem{ErrorCode::kInvalidParameter, "bad \xff \x01 \"text\"",
                  std::string("\xc3\0\"", 3)};
  problem.limit = std::numeric_limits<double>::infinity();
  const json parsed = json::parse(EncodeProblem(problem, "\xfe"));
  EXPECT_EQ(parsed["code"], "invalid_parameter");
  EXPECT_TRUE(parsed["limit"].is_null());
}

TEST(Problems, AreEncodedForEveryCode) {
  for (const ErrorRow& row : ErrorTable()) {
    const json parsed = json::parse(EncodeProblem({row.code, "x"}, ""));
    EXPECT_EQ(parsed["code"], Name(row.code));
    EXPECT_EQ(parsed["status"], row.status);
    EXPECT_EQ(parsed["type"], "/problems/" + std::string(Name(row.code)));
    EXPECT_EQ(ParseErrorCode(Name(row.code)), row.code);
    EXPECT_GE(row.status, 400);
    EXPECT_LT(row.status, 600);
    EXPECT_FALSE(row.title.empty() || row.meaning.empty());
  }
  EXPECT_EQ(ParseErrorCode("teapot"), std::nullopt);
}

TEST(Descriptions, SayWhatIsKnownSoFar) {
  TreeDescription tree;
  tree.id = "x-auto";
  tree.progress = 0.5;
  tree.mesh.sha256 = "x";
  tree.mesh.bytes = 10;
  json parsed = json::parse(EncodeDescription(tree));
  EXPECT_EQ(parsed["state"], "building");
  EXPECT_EQ(parsed["mesh"], json::parse(R"({"sha256":"x","bytes":10})"));
  EXPECT_FALSE(parsed.contains("tree"));
  EXPECT_FALSE(parsed.contains("plan"));

  tree.mesh_known = true;
  tree.mesh.format = MeshFormat::kPly;
  tree.mesh.bounds = {{-1, -2, -3}, {0.1, 2, 3}};
  tree.mesh.health.closed = true;
  parsed = json::parse(EncodeDescription(tree));
  EXPECT_EQ(parsed["mesh"]["format"], "ply");
  EXPECT_EQ(parsed["mesh"]["bounds"]["max"], json::parse("[0.1,2,3]"));
  EXPECT_EQ(parsed["mesh"]["health"]["closed"], true);
  for (const char* unknown : {"groups", "area", "volume"}) {
    EXPECT_FALSE(parsed["mesh"].contains(unknown)) << unknown;
  }
  tree.mesh.groups = {"left \"wing\"", ""};
  tree.mesh.area = 1.5;
  tree.mesh.volume = -0.0;
  parsed = json::parse(EncodeDescription(tree));
  EXPECT_EQ(parsed["mesh"]["groups"], json::parse(R"(["left \"wing\"", ""])"));
  EXPECT_FALSE(std::signbit(parsed["mesh"]["volume"].get<double>()));

  tree.ready = true;
  tree.progress = 1;
  tree.tree = TreeFacts{};
  tree.tree->build = Build::kBox;
  tree.tree->leaf_histogram = {0, 3};
  tree.tree->max_leaf = 1;
  tree.plan = "a box";
  parsed = json::parse(EncodeDescription(tree));
  EXPECT_EQ(parsed["state"], "ready");
  EXPECT_EQ(parsed["tree"]["build"], "box");
  EXPECT_EQ(parsed["tree"]["leaf_histogram"], json::parse("[0,3]"));
  EXPECT_EQ(parsed["tree"]["max_leaf"], 1);
  EXPECT_EQ(parsed["plan"], "a box");
}

TEST(Pages, HoldTheirTreesAndTheCursor) {
  TreePage page;
  EXPECT_EQ(EncodePage(page), R"({"trees":[],"next":null})");
  page.trees.resize(2);
  page.next = "c\"1";
  const json parsed = json::parse(EncodePage(page));
  EXPECT_EQ(parsed["trees"].size(), 2u);
  EXPECT_EQ(parsed["next"], "c\"1");
}

TEST(Cells, AreListedWithTheirBoxes) {
  EXPECT_EQ(EncodeCells({}), R"({"cells":[]})");
  EXPECT_EQ(EncodeCells({{{{0, -1, 1e-7}, {1, 2, 3}}, 2, false, 10}, {{}, 3, true, 0}}),
            R"({"cells":[{"min":[0,-1,1e-07],"max":[1,2,3],"depth":2,"leaf":false,"triangles":10},)"
            R"({"min":[0,0,0],"max":[0,0,0],"depth":3,"leaf":true,"triangles":0}]})");
}

TEST(Capabilities, TellTheLimitsInForce) {
  Limits limits;
  limits.max_rays = 5;
  const json parsed = json::parse(EncodeCapabilities("9.8.7", limits));
  EXPECT_EQ(parsed["name"], "kdray");
  EXPECT_EQ(parsed["version"], "9.8.7");
  EXPECT_EQ(parsed["limits"]["max_rays"], 5);
  EXPECT_EQ(parsed["limits"]["max_batch_bytes"], limits.MaxBatchBytes());
}

}  // namespace
}  // namespace kdray::api
