// SPDX-License-Identifier: Apache-2.0
// The contract over a real socket: every endpoint.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <limits>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "api/errors.h"
#include "server/pages/viewer_files.h"
#include "tests/integration/service_over_http.h"

namespace kdray::server {
namespace {

using namespace std::chrono_literals;
using nlohmann::json;
using test::Json;
using test::RawAnswer;
using test::RunningService;
using testing::HasSubstr;
using testing::StartsWith;

TEST_F(ServiceOverHttp, TakesAMeshOnce) {
  const RawAnswer first = running_.Ask("POST", "/v1/trees?build=box", "mesh");
  EXPECT_EQ(first.status, 201);
  const std::string id = Json(first).at("id");
  EXPECT_THAT(id, testing::EndsWith("-box"));
  EXPECT_EQ(first.Header("location"), "/v1/trees/" + id);
  EXPECT_EQ(first.Header("cache-control"), "no-store");
  EXPECT_THAT(first.Header("server-timing"), HasSubstr("build;dur="));

  const RawAnswer again = running_.Ask("POST", "/v1/trees?build=box", "mesh");
  EXPECT_EQ(again.status, 200);
  EXPECT_EQ(Json(again).at("id"), id);
  const RawAnswer other = running_.Ask("POST", "/v1/trees?build=bvh&mesh=" + id.substr(0, 64));
  EXPECT_EQ(other.status, 201);
  EXPECT_EQ(Json(other).at("id"), id.substr(0, 64) + "-bvh");
}

TEST_F(ServiceOverHttp, AnswersBeforeTheTreeIsBuiltWhenTheClientDoesNotWait) {
  const auto start = std::chrono::steady_clock::now();
  const RawAnswer answer = running_.Ask("POST", "/v1/trees?wait_ms=0", "building");
  EXPECT_LT(std::chrono::steady_clock::now() - start, 5s);
  EXPECT_EQ(answer.status, 202);
  EXPECT_EQ(Json(answer).at("state"), "building");
  const std::string path = answer.Header("location");
  EXPECT_EQ(Json(running_.Ask("GET", path)).at("state"), "building");
  EXPECT_EQ(Json(running_.Ask("GET", path + "?wait_ms=20")).at("state"), "building");
  backend_.finish_builds = true;
  EXPECT_EQ(Json(running_.Ask("GET", path + "?wait_ms=60000")).at("state"), "ready");
}

TEST_F(ServiceOverHttp, AnswersAQueryOnATreeThatIsBeingBuiltWithinItsDeadline) {
  const std::string id = running_.Upload("building", "?wait_ms=0");
  const RawAnswer early =
      running_.Ask("POST", "/v1/trees/" + id + "/rays/any?deadline_ms=30", kRays);
  EXPECT_EQ(early.status, 409);
  EXPECT_EQ(Json(early).at("code"), "tree_building");
  EXPECT_EQ(early.Header("retry-after"), "1");
  std::jthread finisher([this] {
    std::this_thread::sleep_for(50ms);  // real time: the query should be waiting by then
    backend_.finish_builds = true;
  });
  EXPECT_EQ(running_.Ask("POST", "/v1/trees/" + id + "/rays/any", kRays).status, 200);
}

TEST_F(ServiceOverHttp, AnswersTheProblemOfAMeshThatIsBroken) {
  const RawAnswer answer = running_.Ask("POST", "/v1/trees", "broken");
  EXPECT_EQ(answer.status, 422);
  EXPECT_EQ(Json(answer).at("code"), "invalid_mesh");
  EXPECT_EQ(Json(answer).at("line"), 1);
  EXPECT_EQ(running_.Code("POST", "/v1/trees"), "empty_mesh");
}

TEST_F(ServiceOverHttp, ListsDescribesAndForgetsTrees) {
  std::set<std::string> ids;
  for (const char* mesh : {"a", "b", "c"}) ids.insert(running_.Upload(mesh));
  std::set<std::string> listed;
  std::string query = "?limit=2";
  for (int page = 0; page < 2; ++page) {
    const RawAnswer answer = running_.Ask("GET", "/v1/trees" + query);
    EXPECT_EQ(answer.Header("cache-control"), "no-cache");
    const json object = Json(answer);
    for (const json& tree : object.at("trees")) listed.insert(tree.at("id"));
    if (page == 0) {
      query = "?limit=2&after=" + object.at("next").get<std::string>();
    } else {
      EXPECT_TRUE(object.at("next").is_null());
    }
  }
  EXPECT_EQ(listed, ids);

  const std::string path = "/v1/trees/" + *ids.begin();
  EXPECT_EQ(Json(running_.Ask("GET", path)).at("id"), *ids.begin());
  EXPECT_EQ(running_.Ask("GET", path).Header("cache-control"), "no-cache");
  const RawAnswer gone = running_.Ask("DELETE", path);
  EXPECT_EQ(gone.status, 204);
  EXPECT_TRUE(gone.body.empty());
  EXPECT_EQ(running_.Code("GET", path), "tree_not_found");
  EXPECT_EQ(running_.Code("DELETE", path), "tree_not_found");
}

TEST_F(ServiceOverHttp, GivesTheMeshBack) {
  const std::string mesh(1'000'000, 'm');
  const std::string id = running_.Upload(mesh);
  const RawAnswer answer = running_.Ask("GET", "/v1/trees/" + id + "/mesh");
  EXPECT_EQ(answer.body, mesh);
  EXPECT_EQ(answer.Header("content-type"), "application/octet-stream");
  EXPECT_EQ(answer.Header("cache-control"), "public, max-age=31536000, immutable");
  EXPECT_EQ(answer.Header("etag"), "\"" + id.substr(0, 64) + "\"");
  const RawAnswer cached = running_.Ask("GET", "/v1/trees/" + id + "/mesh", "",
                                        "If-None-Match: " + answer.Header("etag") + "\r\n");
  EXPECT_EQ(cached.status, 304);
  EXPECT_EQ(cached.headers.count("content-length"), 0U);
  EXPECT_EQ(running_.Ask("HEAD", "/v1/trees/" + id + "/mesh").Header("content-length"), "1000000");
}

TEST_F(ServiceOverHttp, AnswersRaysInJson) {
  const RawAnswer answer = running_.Ask("POST", Tree("/rays/closest"), kRays);
  EXPECT_EQ(answer.status, 200);
  EXPECT_EQ(answer.Header("content-type"), "application/json");
  EXPECT_EQ(answer.Header("vary"), "Accept");
  EXPECT_EQ(answer.Header("cache-control"), "no-store");
  EXPECT_EQ(answer.Header("kdray-precision"), "watertight");
  EXPECT_EQ(answer.Header("kdray-invalid"), "0");
  for (const char* part : {"queue;dur=", "parse;dur=", "trace;dur=", "encode;dur="}) {
    EXPECT_THAT(answer.Header("server-timing"), HasSubstr(part));
  }
  const json results = Json(answer).at("results");
  EXPECT_EQ(results.at(0).at("t"), 1);
  EXPECT_TRUE(results.at(1).is_null());
  EXPECT_EQ(Json(running_.Ask("POST", Tree("/rays/any"), kRays)).at("results"),
            json({true, false}));
}

TEST_F(ServiceOverHttp, CountsAndListsHits) {
  const RawAnswer count = running_.Ask("POST", Tree("/rays/count"), kRays);
  EXPECT_EQ(Json(count), json::parse(R"({"results":[1,0],"invalid":[],"truncated":[]})"));
  EXPECT_EQ(count.Header("kdray-precision"), "exact");
  EXPECT_EQ(count.headers.count("kdray-truncated"), 0U) << "no row of it can be cut";
  EXPECT_EQ(count.headers.count("kdray-offset"), 0U);

  const RawAnswer all = running_.Ask("POST", Tree("/rays/all?fields=triangle,side"), kRays);
  EXPECT_EQ(Json(all).at("results"),
            json::parse(R"([[{"triangle":0,"side":1},{"triangle":1,"side":1}],[]])"));
  EXPECT_EQ(all.Header("kdray-truncated"), "0");
  const RawAnswer cut =
      running_.Ask("POST", Tree("/rays/all?fields=t&max_hits=1&t_min=auto"), kRays);
  EXPECT_EQ(Json(cut), json::parse(R"({"results":[[{"t":1}],[]],"invalid":[],"truncated":[0]})"));
  EXPECT_EQ(cut.Header("kdray-truncated"), "1");
  EXPECT_EQ(cut.Header("kdray-offset"), "0.25");

  const RawAnswer npy =
      running_.Ask("POST", Tree("/rays/all?fields=t"), NpyRays({0, 0, 1, 0, 0, -1}));
  EXPECT_THAT(npy.body, HasSubstr("[('ray', '<i4'), ('t', '<f4')]"));
  EXPECT_THAT(npy.body, HasSubstr("'shape': (2,)"));
}

TEST_F(ServiceOverHttp, HoldsTheMemoryOfAnAnswerUntilItIsSent) {
  const std::string rays = NpyRays(std::vector<float>(6 * 100'000, 1));
  EXPECT_EQ(running_.Ask("POST", Tree("/rays/closest?dtype=f8&fields=t,normal,point"), rays).status,
            200);
  EXPECT_TRUE(test::WaitUntil([&] { return running_.service().request_memory_used() == 0; }));
}

TEST_F(ServiceOverHttp, AnswersRaysInNpyAndCrosswise) {
  const std::string npy = NpyRays({0, 0, 1, 0, 0, -1});
  const RawAnswer same = running_.Ask("POST", Tree("/rays/any"), npy);
  EXPECT_EQ(same.Header("content-type"), "application/x-npy");
  EXPECT_THAT(same.body, StartsWith("\x93NUMPY"));
  EXPECT_EQ(same.body.back(), '\x01');
  const RawAnswer as_json =
      running_.Ask("POST", Tree("/rays/any"), npy, "Accept: application/json\r\n");
  EXPECT_EQ(Json(as_json).at("results"), json({true}));
  const RawAnswer as_npy =
      running_.Ask("POST", Tree("/rays/any"), kRays, "Accept: application/x-npy\r\n");
  EXPECT_THAT(as_npy.body, StartsWith("\x93NUMPY"));
  EXPECT_EQ(running_.Code("POST", Tree("/rays/any"), kRays, "Accept: text/html\r\n"),
            "not_acceptable");
}

TEST_F(ServiceOverHttp, NamesRowsThatCannotBe) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const RawAnswer answer =
      running_.Ask("POST", Tree("/rays/closest"), NpyRays({0, 0, 1, 0, 0, -1, 0, 0, 1, 0, 0, nan}),
                   "Accept: application/json\r\n");
  EXPECT_EQ(answer.status, 200);
  EXPECT_EQ(answer.Header("kdray-invalid"), "1");
  EXPECT_EQ(Json(answer).at("invalid"), json({1}));
}

TEST_F(ServiceOverHttp, RefusesBodiesThatAreNoBatch) {
  const std::string integers = test::NpyArray(std::vector<std::int32_t>(6), 6);
  for (const auto& [body, code] : std::vector<std::pair<std::string, std::string>>{
           {"{\"rays\":[[0,0,1,0,0,-1]", "invalid_json"},
           {"{\"rays\":[[0,0,1,0,0]]}", "invalid_json"},
           {"{\"rays\":[[0,0,1,0,0,\"x\"]]}", "invalid_json"},
           {"{\"rays\":[],\"rays\":[]}", "invalid_json"},
           {"{\"rays\":[[1e999,0,1,0,0,1]]}", "invalid_json"},
           {"{\"reys\":[]}", "invalid_parameter"},
           {"", "invalid_json"},
           {integers, "invalid_array"},
           {NpyRays({1, 2, 3, 4, 5, 6}).substr(0, 140), "invalid_array"}}) {
    const RawAnswer answer = running_.Ask("POST", Tree("/rays/closest"), body);
    EXPECT_EQ(answer.status, 400) << body;
    EXPECT_EQ(RunningService::CodeOf(answer), code) << body;
  }
  EXPECT_EQ(running_.Code("POST", Tree("/rays/any"), kRays, "Content-Type: text/csv\r\n"),
            "unsupported_media_type");
}

TEST_F(ServiceOverHttp, RendersByParametersAndByJson) {
  const RawAnswer by_get = running_.Ask("GET", Tree("/render.png?width=10&height=5"));
  EXPECT_EQ(by_get.status, 200);
  EXPECT_EQ(by_get.Header("content-type"), "image/png");
  EXPECT_THAT(by_get.body, StartsWith("\x89PNG"));
  EXPECT_EQ(by_get.Header("cache-control"), "public, max-age=3600");
  EXPECT_EQ(by_get.Header("kdray-precision"), "watertight");
  const RawAnswer by_post = running_.Ask("POST", Tree("/render.png"), R"({"width":10,"height":5})");
  EXPECT_EQ(by_post.body, by_get.body);
  EXPECT_EQ(by_post.Header("cache-control"), "no-store");
  const RawAnswer array = running_.Ask("GET", Tree("/render.npy?mode=depth&width=3&height=2"));
  EXPECT_EQ(array.Header("content-type"), "application/x-npy");
  EXPECT_THAT(array.body, HasSubstr("(2, 3)"));
  EXPECT_THAT(
      running_.Ask("POST", Tree("/render.npy"), R"({"mode":"depth","width":3,"height":2})").body,
      HasSubstr("(2, 3)"));
}

TEST_F(ServiceOverHttp, AnswersARenderThatTheClientHasWithoutRendering) {
  const RawAnswer first = running_.Ask("GET", Tree("/render.png?width=10&height=5"));
  const std::string etag = first.Header("etag");
  EXPECT_THAT(etag, testing::MatchesRegex("\"[0-9a-f]+\""));
  const int renders = backend_.renders;
  const std::string condition = "If-None-Match: " + etag + "\r\n";
  const RawAnswer same =
      running_.Ask("GET", Tree("/render.png?height=5&width=10&seed=0"), "", condition);
  EXPECT_EQ(same.status, 304);
  EXPECT_EQ(same.Header("etag"), etag);
  EXPECT_EQ(same.Header("cache-control"), "public, max-age=3600");
  EXPECT_EQ(backend_.renders, renders);
  EXPECT_EQ(running_.Ask("GET", Tree("/render.png?height=6&width=10"), "", condition).status, 200);
  EXPECT_EQ(running_.Ask("GET", Tree("/render.npy?height=5&width=10"), "", condition).status, 200);
  EXPECT_EQ(running_.Ask("HEAD", Tree("/render.png?width=10&height=5")).Header("etag"), etag);
}

TEST_F(ServiceOverHttp, TellsRendersOfDifferentCamerasAndModesApart) {
  std::set<std::string> etags;
  const std::vector<std::string> queries = {"",
                                            "view=front",
                                            "view=iso",
                                            "projection=spherical",
                                            "projection=spherical&h_fov_deg=90",
                                            "projection=spherical&v_fov_deg=90",
                                            "intrinsic=9,9,5,5",
                                            "intrinsic=9,9,5,6",
                                            "extrinsic=1,0,0,0,0,1,0,0,0,0,1,5,0,0,0,1",
                                            "extrinsic=1,0,0,0,0,1,0,0,0,0,1,6,0,0,0,1",
                                            "mode=depth",
                                            "mode=depth&depth_range=1,2",
                                            "mode=depth&depth_range=1,3",
                                            "mode=cost",
                                            "edges=true"};
  for (const std::string& query : queries) {
    const std::string target = Tree("/render.png?" + query);
    const RawAnswer answer = running_.Ask("GET", target);
    ASSERT_EQ(answer.status, 200) << query << answer.body;
    const std::string etag = answer.Header("etag");
    EXPECT_TRUE(etags.insert(etag).second) << query;
    const RawAnswer head = running_.Ask("HEAD", target);
    EXPECT_EQ(head.status, 200);
    EXPECT_EQ(head.Header("etag"), etag);
    EXPECT_EQ(head.Header("kdray-depth-range"), answer.Header("kdray-depth-range"));
    EXPECT_EQ(running_.Ask("GET", target, "", "If-None-Match: " + etag + "\r\n").status, 304);
  }
  EXPECT_EQ(running_.Ask("GET", Tree("/render.png?mode=depth&depth_range=1,2.5"))
                .Header("kdray-depth-range"),
            "1,2.5");
}

TEST_F(ServiceOverHttp, SaysWhatASampledImageReachedAndKeepsNoneThatWasCut) {
  const RawAnswer whole = running_.Ask("GET", Tree("/render.png?max_noise=0.1"));
  EXPECT_EQ(whole.Header("kdray-samples"), "3");
  EXPECT_EQ(whole.Header("kdray-noise"), "0.25");
  EXPECT_EQ(whole.Header("kdray-stopped"), "done");
  EXPECT_EQ(whole.Header("cache-control"), "public, max-age=3600");
  EXPECT_NE(whole.Header("etag"), "");
  const RawAnswer cut = running_.Ask("GET", Tree("/render.npy?budget_ms=10"));
  EXPECT_EQ(cut.status, 200);
  EXPECT_EQ(cut.Header("kdray-stopped"), "budget");
  EXPECT_EQ(cut.Header("kdray-noise"), "");
  EXPECT_EQ(cut.Header("cache-control"), "no-store");
  EXPECT_EQ(cut.Header("etag"), "");
}

TEST_F(ServiceOverHttp, ListsCells) {
  const RawAnswer answer = running_.Ask("GET", Tree("/cells?depth=2"));
  EXPECT_EQ(answer.status, 200);
  const json cell = Json(answer).at("cells").at(0);
  EXPECT_EQ(cell.at("depth"), 2);
  EXPECT_EQ(cell.at("leaf"), true);
  EXPECT_EQ(cell.at("max"), json({1, 1, 1}));
  EXPECT_EQ(answer.Header("cache-control"), "public, max-age=3600");
  EXPECT_EQ(running_
                .Ask("GET", Tree("/cells?depth=2"), "",
                     "If-None-Match: " + answer.Header("etag") + "\r\n")
                .status,
            304);
  EXPECT_EQ(running_.Code("GET", Tree("/cells?depth=31")), "too_many_cells");
  EXPECT_EQ(running_.Code("GET", Tree("/cells")), "invalid_parameter");
}

TEST_F(ServiceOverHttp, MeasuresATradeoffWhenItIsAskedTo) {
  const std::string path = Tree("/tradeoff");
  EXPECT_EQ(running_.Code("GET", path), "not_measured");
  EXPECT_EQ(running_.Code("DELETE", path), "not_measured");
  EXPECT_EQ(running_.Code("POST", path, "body"), "malformed_request");

  backend_.hold = true;
  const RawAnswer begun = running_.Ask("POST", path + "?wait_ms=0");
  EXPECT_EQ(begun.status, 202);
  EXPECT_EQ(Json(begun), json({{"state", "measuring"}, {"progress", 0.5}}));
  EXPECT_EQ(begun.Header("cache-control"), "no-store");
  EXPECT_EQ(running_.Ask("GET", path).status, 202);

  backend_.hold = false;
  const RawAnswer ended = running_.Ask("GET", path);
  EXPECT_EQ(ended.status, 200);
  EXPECT_EQ(Json(ended).at("results").size(), 24U);
  EXPECT_EQ(ended.Header("cache-control"), "no-cache");
  EXPECT_EQ(running_.Ask("POST", path).status, 200);

  EXPECT_EQ(running_.Ask("DELETE", path).status, 204);
  EXPECT_EQ(running_.Code("GET", path), "not_measured");
  for (const char* method : {"GET", "POST", "DELETE"}) {
    EXPECT_EQ(running_.Code(method, "/v1/trees/" + std::string(64, '0') + "-auto/tradeoff"),
              "tree_not_found");
  }
}

TEST_F(ServiceOverHttp, TellsAboutItself) {
  const json capabilities = Json(running_.Ask("GET", "/v1"));
  EXPECT_EQ(capabilities.at("name"), "kdray");
  EXPECT_EQ(capabilities.at("version"), KDRAY_VERSION);
  EXPECT_EQ(Json(running_.Ask("GET", "/healthz")).at("status"), "ok");
  EXPECT_EQ(Json(running_.Ask("GET", "/readyz")).at("status"), "ready");
  EXPECT_TRUE(Json(running_.Ask("GET", "/openapi.json")).contains("paths"));
  for (const char* path : {"/", "/docs", "/problems/tree_not_found"}) {
    const RawAnswer page = running_.Ask("GET", path);
    EXPECT_EQ(page.status, 200) << path;
    EXPECT_EQ(page.Header("content-type"), "text/html; charset=utf-8") << path;
    EXPECT_THAT(page.Header("content-security-policy"), HasSubstr("default-src 'none'")) << path;
    EXPECT_EQ(page.Header("x-content-type-options"), "nosniff") << path;
  }
}

TEST_F(ServiceOverHttp, ServesTheViewerWithAllItsFiles) {
  for (const ViewerFile& file : ViewerFiles()) {
    const RawAnswer answer = running_.Ask("GET", file.path + "?tree=x");
    EXPECT_EQ(answer.status, 200) << file.path;
    EXPECT_EQ(answer.body, file.bytes);
    EXPECT_EQ(answer.Header("content-type"), file.content_type);
    EXPECT_EQ(answer.Header("x-content-type-options"), "nosniff");
    EXPECT_THAT(answer.Header("content-security-policy"), HasSubstr("script-src 'self'"));
    EXPECT_EQ(running_.Ask("GET", file.path, "", "If-None-Match: " + file.etag + "\r\n").status,
              304);
  }
}

TEST_F(ServiceOverHttp, HasAPageForEveryProblem) {
  for (const api::ErrorRow& row : api::ErrorTable()) {
    const RawAnswer page = running_.Ask("GET", "/problems/" + std::string(api::Name(row.code)));
    EXPECT_EQ(page.status, 200) << api::Name(row.code);
    EXPECT_THAT(page.body, HasSubstr(api::Name(row.code)));
  }
  EXPECT_EQ(running_.Code("GET", "/problems/none"), "not_found");
}

TEST_F(ServiceOverHttp, AnswersHeadWhereverGetWorks) {
  for (const std::string& path :
       {std::string("/"), std::string("/healthz"), std::string("/readyz"),
        std::string("/openapi.json"), std::string("/docs"), std::string("/v1"),
        std::string("/problems/internal"), std::string("/v1/trees"), Tree(""), Tree("/mesh"),
        Tree("/render.png"), Tree("/render.npy"), Tree("/cells?depth=0")}) {
    const RawAnswer get = running_.Ask("GET", path);
    const RawAnswer head = running_.Ask("HEAD", path);
    EXPECT_EQ(head.status, 200) << path;
    EXPECT_EQ(head.Header("content-length"), std::to_string(get.body.size())) << path;
    EXPECT_EQ(head.Header("content-type"), get.Header("content-type")) << path;
  }
}

}  // namespace
}  // namespace kdray::server
