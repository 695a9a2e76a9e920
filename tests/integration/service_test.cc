// The contract over a real socket, with a backend that has no geometry: every endpoint, every kind
// of refusal.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <cstdint>
#include <limits>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "api/errors.h"
#include "server/pages/viewer_files.h"
#include "tests/support/fake_backend.h"
#include "tests/support/npy_array.h"
#include "tests/support/service_fixture.h"

namespace kdray::server {
namespace {

using namespace std::chrono_literals;
using nlohmann::json;
using test::Json;
using test::MakeRequest;
using test::RawAnswer;
using test::RawClient;
using test::RunningService;
using testing::HasSubstr;
using testing::StartsWith;

constexpr const char* kRays = R"({"rays":[[0,0,1,0,0,-1],[0,0,1,0,0,1]]})";
constexpr const char* kUnknownId =
    "0000000000000000000000000000000000000000000000000000000000000000-auto";

std::string NpyRays(const std::vector<float>& numbers) { return test::NpyArray(numbers, 6); }

class ServiceOverHttp : public testing::Test {
 protected:
  explicit ServiceOverHttp(ServiceOptions options = {}, HttpServerOptions http = {})
      : running_(backend_, std::move(options), std::move(http)) {}
  ~ServiceOverHttp() override { backend_.hold = false; }

  std::string Tree(const std::string& path) {
    if (id_.empty()) id_ = running_.Upload("mesh");
    return "/v1/trees/" + id_ + path;
  }
  static void WaitFor(const auto& condition) {
    for (int i = 0; i < 10000 && !condition(); ++i) std::this_thread::sleep_for(1ms);
    ASSERT_TRUE(condition());
  }

  test::FakeBackend backend_;
  RunningService running_;
  std::string id_;
};

class SmallService : public ServiceOverHttp {
 protected:
  SmallService() : ServiceOverHttp(Small()) {}
  static ServiceOptions Small() {
    ServiceOptions options;
    options.max_running = 1;
    options.max_queued = 1;
    options.limits.max_upload_bytes = 100;
    options.limits.max_rays = 3;
    options.limits.max_pixels = 100;
    options.request_memory_bytes = 100;
    return options;
  }
};

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
    std::this_thread::sleep_for(50ms);
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
      running_.Ask("GET", Tree("/render.png?height=5&width=10&samples=1"), "", condition);
  EXPECT_EQ(same.status, 304);
  EXPECT_EQ(same.Header("etag"), etag);
  EXPECT_EQ(same.Header("cache-control"), "public, max-age=3600");
  EXPECT_EQ(backend_.renders, renders);
  EXPECT_EQ(running_.Ask("GET", Tree("/render.png?height=6&width=10"), "", condition).status, 200);
  EXPECT_EQ(running_.Ask("GET", Tree("/render.npy?height=5&width=10"), "", condition).status, 200);
  EXPECT_EQ(running_.Ask("HEAD", Tree("/render.png?width=10&height=5")).Header("etag"), etag);
}

TEST_F(ServiceOverHttp, SaysWhatASampledImageReachedAndKeepsNoneThatWasCut) {
  const RawAnswer whole = running_.Ask("GET", Tree("/render.png?max_noise=0.1"));
  EXPECT_EQ(whole.Header("kdray-samples"), "2.5");
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

TEST_F(ServiceOverHttp, RefusesUnknownParametersEverywhere) {
  for (const auto& [method, path] :
       std::vector<std::pair<std::string, std::string>>{{"GET", "/v1"},
                                                        {"GET", "/healthz"},
                                                        {"GET", "/readyz"},
                                                        {"GET", "/openapi.json"},
                                                        {"GET", "/docs"},
                                                        {"GET", "/problems/internal"},
                                                        {"GET", "/v1/trees"},
                                                        {"POST", "/v1/trees"},
                                                        {"GET", Tree("")},
                                                        {"DELETE", Tree("")},
                                                        {"GET", Tree("/mesh")},
                                                        {"POST", Tree("/rays/closest")},
                                                        {"POST", Tree("/rays/any")},
                                                        {"GET", Tree("/render.png")},
                                                        {"POST", Tree("/render.png")},
                                                        {"GET", Tree("/render.npy")},
                                                        {"POST", Tree("/render.npy")},
                                                        {"GET", Tree("/cells")},
                                                        {"POST", Tree("/tradeoff")},
                                                        {"GET", Tree("/tradeoff")},
                                                        {"DELETE", Tree("/tradeoff")}}) {
    const RawAnswer answer = running_.Ask(method, path + "?typo=1");
    EXPECT_EQ(RunningService::CodeOf(answer), "invalid_parameter") << method << path;
    EXPECT_EQ(Json(answer).at("parameter"), "typo") << method << path;
  }
  EXPECT_EQ(running_.Ask("GET", Tree("")).status, 200);
}

TEST_F(ServiceOverHttp, ChecksEveryFieldOfARequest) {
  struct Field {
    std::string method, path, body;
    std::string good;  ///< at its limits
    std::vector<std::string> bad;
  };
  const std::vector<Field> fields = {
      {"POST",
       "/v1/trees",
       "mesh",
       "wait_ms=0",
       {"wait_ms=-1", "wait_ms=60001", "wait_ms=x", "wait_ms=", "wait_ms=1.5",
        "wait_ms=0&wait_ms=0"}},
      {"POST", "/v1/trees", "mesh", "wait_ms=60000", {}},
      {"POST",
       "/v1/trees",
       "mesh",
       "build=kd-median",
       {"build=", "build=KD-SAH", "build=quadtree"}},
      {"GET", "/v1/trees", "", "limit=1", {"limit=0", "limit=-1", "limit=x"}},
      {"GET", "/v1/trees", "", "", {"mesh=abc", "mesh=" + std::string(64, 'A')}},
      {"GET", Tree(""), "", "wait_ms=60000", {"wait_ms=60001", "wait_ms=-1"}},
      {"POST",
       Tree("/rays/closest"),
       kRays,
       "deadline_ms=600000",
       {"deadline_ms=600001", "deadline_ms=-1", "deadline_ms=x"}},
      {"POST",
       Tree("/rays/closest"),
       kRays,
       "precision=watertight",
       {"precision=", "precision=best", "precision=Fast"}},
      {"POST",
       Tree("/rays/closest"),
       kRays,
       "fields=triangle,t",
       {"fields=", "fields=t,t", "fields=w", "fields=t,"}},
      {"POST", Tree("/rays/closest"), kRays, "dtype=f4", {"dtype=f2", "dtype="}},
      {"POST",
       Tree("/rays/closest"),
       kRays,
       "t_min=-1&t_max=5",
       {"t_min=x", "t_max=nan", "t_min=2&t_max=1"}},
      {"POST", Tree("/rays/any"), kRays, "t_min=0&t_max=0", {"fields=t", "max_hits=1"}},
      {"GET",
       Tree("/render.png"),
       "",
       "width=1&height=1",
       {"width=0", "width=-1", "width=x", "height=1.5", "width=1&width=1"}},
      {"GET", Tree("/render.png"), "", "mode=depth", {"mode=", "mode=wireframe", "mode=cost"}},
      {"GET", Tree("/render.png"), "", "samples=1024", {"samples=0", "samples=1025"}},
      {"GET",
       Tree("/render.png"),
       "",
       "eye=1,2,3&target=0,0,0&up=0,0,1",
       {"eye=1,2", "eye=1,2,3,4", "eye=a,b,c", "up=1,2,"}},
      {"GET",
       Tree("/render.png"),
       "",
       "region=0,0,640,480",
       {"region=0,0,641,480", "region=5,0,5,1", "region=-1,0,1,1", "region=1,2,3"}},
      {"GET",
       Tree("/render.png"),
       "",
       "background=transparent&color=0,0.5,1",
       {"background=blue", "color=0,0,1.5", "color=-0.1,0,0"}},
      {"GET",
       Tree("/render.png"),
       "",
       "projection=orthographic&view_height=2",
       {"projection=fish", "view_height=0", "view_height=-1"}},
      {"GET", Tree("/render.png"), "", "fov_deg=90", {"fov_deg=0", "fov_deg=180", "fov_deg=x"}},
      {"GET", Tree("/cells"), "", "depth=0", {"depth=-1", "depth=x", "depth=", "depth=1&depth=1"}},
  };
  for (const Field& field : fields) {
    const RawAnswer good = running_.Ask(field.method, field.path + "?" + field.good, field.body);
    EXPECT_LT(good.status, 300) << field.path << "?" << field.good << "\n" << good.body;
    for (const std::string& bad : field.bad) {
      const RawAnswer answer = running_.Ask(field.method, field.path + "?" + bad, field.body);
      EXPECT_EQ(answer.status, 400) << field.path << "?" << bad;
      EXPECT_EQ(RunningService::CodeOf(answer), "invalid_parameter") << field.path << "?" << bad;
    }
  }
}

TEST_F(ServiceOverHttp, ChecksTheFieldsOfARenderInJson) {
  EXPECT_EQ(running_.Ask("POST", Tree("/render.png"), "{}").status, 200);
  for (const auto& [body, code] : std::vector<std::pair<const char*, const char*>>{
           {R"({"width":0})", "invalid_parameter"},
           {R"({"wdith":1})", "invalid_parameter"},
           {R"({"mode":"wireframe"})", "invalid_parameter"},
           {R"({"width":"1"})", "invalid_json"},
           {R"({"width":1.5})", "invalid_parameter"},
           {R"({"eye":"1,2,3"})", "invalid_json"},
           {R"({"width":1,"width":1})", "invalid_json"},
           {R"([])", "invalid_json"},
           {R"({"width":1)", "invalid_json"}}) {
    EXPECT_EQ(running_.Ask("POST", Tree("/render.png"), body).status, 400) << body;
    EXPECT_EQ(running_.Code("POST", Tree("/render.png"), body), code) << body;
  }
}

TEST_F(ServiceOverHttp, KnowsNoTreeThatIsNotThere) {
  for (const std::string& id : {std::string(kUnknownId), std::string("x"), std::string("../v1"),
                                std::string("%2e%2e"), std::string("%00"), std::string(500, 'a')}) {
    if (id.find('/') == std::string::npos) {
      EXPECT_EQ(running_.Code("GET", "/v1/trees/" + id), "tree_not_found") << id;
      EXPECT_EQ(running_.Code("GET", "/v1/trees/" + id + "/mesh"), "tree_not_found") << id;
      EXPECT_EQ(running_.Code("GET", "/v1/trees/" + id + "/render.png"), "tree_not_found") << id;
      EXPECT_EQ(running_.Code("POST", "/v1/trees/" + id + "/rays/any", kRays), "tree_not_found")
          << id;
    } else {
      EXPECT_EQ(running_.Code("GET", "/v1/trees/" + id), "not_found") << id;
    }
  }
  EXPECT_EQ(running_.Code("POST", "/v1/trees?mesh=" + std::string(64, '0')), "mesh_not_found");
}

TEST_F(ServiceOverHttp, EndsAQueryAtItsDeadline) {
  backend_.hold = true;
  const auto start = std::chrono::steady_clock::now();
  EXPECT_EQ(running_.Code("POST", Tree("/rays/any?deadline_ms=50"), kRays), "deadline_exceeded");
  EXPECT_EQ(running_.Code("GET", Tree("/render.png?deadline_ms=50")), "deadline_exceeded");
  EXPECT_LT(std::chrono::steady_clock::now() - start, 5s);
}

TEST_F(ServiceOverHttp, SaysWhichTimeHasPassed) {
  const std::string building = "/v1/trees/" + running_.Upload("building", "?wait_ms=0");
  backend_.hold = true;
  const std::string json_render = R"({"deadline_ms":34})";
  const auto expect = [](const RawAnswer& answer, const std::string& code,
                         const std::string& parameter, double limit, const std::string& text) {
    const json problem = Json(answer);
    EXPECT_EQ(problem.at("code"), code);
    EXPECT_EQ(problem.value("parameter", ""), parameter) << problem;
    EXPECT_EQ(problem.at("limit"), limit) << problem;
    EXPECT_THAT(problem.at("detail").get<std::string>(), HasSubstr(text));
  };
  const std::string late = "deadline_exceeded";
  expect(running_.Ask("POST", Tree("/rays/closest?deadline_ms=31"), kRays), late, "deadline_ms", 31,
         "deadline_ms is 31");
  expect(running_.Ask("POST", Tree("/rays/any?deadline_ms=32"), kRays), late, "deadline_ms", 32,
         "deadline_ms is 32");
  expect(running_.Ask("GET", Tree("/render.npy?mode=depth&deadline_ms=33")), late, "deadline_ms",
         33, "deadline_ms is 33");
  expect(running_.Ask("POST", Tree("/render.png"), json_render), late, "/deadline_ms", 34,
         "deadline_ms is 34");
  expect(running_.Ask("POST", building + "/rays/any?deadline_ms=35", kRays), "tree_building",
         "deadline_ms", 35, "deadline_ms is 35");
  expect(running_.Ask("GET", building + "/render.png?deadline_ms=36"), "tree_building",
         "deadline_ms", 36, "deadline_ms is 36");
  // What was not sent is told as well.
  backend_.query_problem =
      api::Problem{.code = api::ErrorCode::kDeadlineExceeded, .detail = "late"};
  expect(running_.Ask("POST", Tree("/rays/any"), kRays), late, "deadline_ms", 30000,
         "deadline_ms is 30000, the default");
  expect(running_.Ask("GET", Tree("/render.png")), late, "deadline_ms", 60000,
         "deadline_ms is 60000, the default");
  expect(running_.Ask("GET", Tree("/cells?depth=1")), late, "", 30000, "30000 ms");
}

TEST_F(SmallService, SaysWhichTimeHasPassedInTheQueue) {
  backend_.hold = true;
  RawClient running(running_.port());
  running.Send(MakeRequest("GET", Tree("/cells?depth=1")));
  WaitFor([&] { return backend_.running == 1; });
  const RawAnswer late = running_.Ask("GET", Tree("/render.png?width=1&height=1&deadline_ms=37"));
  EXPECT_EQ(RunningService::CodeOf(late), "deadline_exceeded");
  EXPECT_EQ(Json(late).at("parameter"), "deadline_ms");
  EXPECT_EQ(Json(late).at("limit"), 37);
  EXPECT_THAT(Json(late).at("detail").get<std::string>(),
              testing::AllOf(HasSubstr("turn"), HasSubstr("deadline_ms is 37")));
}

TEST_F(ServiceOverHttp, TellsThatAClientHasLeftFromWhatFailed) {
  const std::string building = running_.Upload("building", "?wait_ms=0");
  backend_.hold = true;
  const std::string tree = "/v1/trees/" + building;
  const std::vector<std::string> requests = {
      MakeRequest("POST", "/v1/trees?wait_ms=20000", "building"),
      MakeRequest("GET", tree + "?wait_ms=20000"),
      MakeRequest("POST", tree + "/rays/any", kRays),
      MakeRequest("GET", tree + "/render.png"),
      MakeRequest("POST", Tree("/rays/closest"), kRays),
      MakeRequest("GET", Tree("/render.npy?mode=depth")),
      MakeRequest("GET", Tree("/cells?depth=1")),
  };
  std::uint64_t gone = 0;
  for (const std::string& request : requests) {
    for (const bool reset : {false, true}) {
      RawClient client(running_.port());
      client.Send(request);
      std::this_thread::sleep_for(10ms);
      reset ? client.Reset() : client.Close();
      ++gone;
      WaitFor([&] { return running_.service().clients_gone() == gone; });
    }
  }
}

TEST_F(ServiceOverHttp, AnswersAClientThatHalfClosesWhateverItAsksFor) {
  const std::string building = running_.Upload("building", "?wait_ms=0");
  backend_.hold = true;
  for (const std::string& request :
       {MakeRequest("GET", "/v1/trees/" + building + "?wait_ms=100"),
        MakeRequest("POST", Tree("/rays/any"), kRays), MakeRequest("GET", Tree("/render.png")),
        MakeRequest("GET", Tree("/cells?depth=1"))}) {
    RawClient client(running_.port());
    client.Send(request);
    client.ShutdownWrite();
    std::this_thread::sleep_for(50ms);
    backend_.hold = false;
    EXPECT_THAT(client.ReadToEnd(), StartsWith("HTTP/1.1 200 OK\r\n"));
    backend_.hold = true;
  }
}

TEST_F(ServiceOverHttp, StopsWorkWhoseClientHasLeft) {
  backend_.hold = true;
  for (const std::string& request :
       {MakeRequest("POST", Tree("/rays/closest"), kRays), MakeRequest("GET", Tree("/render.png")),
        MakeRequest("GET", Tree("/cells?depth=1"))}) {
    const int cancelled = backend_.cancelled;
    RawClient client(running_.port());
    client.Send(request);
    WaitFor([&] { return backend_.running == 1; });
    const auto left = std::chrono::steady_clock::now();
    client.Close();
    WaitFor([&] { return backend_.cancelled == cancelled + 1; });
    EXPECT_LT(std::chrono::steady_clock::now() - left, 250ms) << request;
  }
}

TEST_F(ServiceOverHttp, KeepsTheConnectionBetweenBatches) {
  const std::string path = Tree("/rays/any");
  RawClient client(running_.port());
  for (int i = 0; i < 50; ++i) {
    client.Send(MakeRequest("POST", path, kRays));
    const auto answer = client.Read();
    ASSERT_TRUE(answer) << i;
    EXPECT_EQ(answer->status, 200);
  }
}

TEST_F(ServiceOverHttp, RefusesAnUploadBeforeItsBodyIsSent) {
  RawClient client(running_.port());
  client.Send(
      "POST /v1/trees HTTP/1.1\r\nHost: h\r\nContent-Length: 9999999999\r\nExpect: "
      "100-continue\r\n\r\n");
  const auto answer = client.Read();
  ASSERT_TRUE(answer);
  EXPECT_EQ(answer->status, 413);
  EXPECT_EQ(RunningService::CodeOf(*answer), "mesh_too_large");
}

TEST_F(ServiceOverHttp, LeavesNothingOfAnUploadThatBreaksOff) {
  {
    RawClient client(running_.port());
    client.Send("POST /v1/trees HTTP/1.1\r\nHost: h\r\nContent-Length: 100\r\n\r\nhalf");
    client.ShutdownWrite();
    EXPECT_EQ(RunningService::CodeOf(*client.Read()), "malformed_request");
  }
  EXPECT_TRUE(Json(running_.Ask("GET", "/v1/trees")).at("trees").empty());
}

TEST_F(ServiceOverHttp, DrainsBeforeItEnds) {
  const std::string query = MakeRequest("POST", Tree("/rays/any"), kRays);
  backend_.hold = true;
  RawClient busy(running_.port());
  busy.Send(query);
  WaitFor([&] { return backend_.running == 1; });
  running_.service().Drain();
  running_.server().Drain();
  EXPECT_EQ(running_.Ask("GET", "/healthz").status, 200);
  EXPECT_EQ(running_.Code("GET", "/readyz"), "draining");
  const RawAnswer refused = running_.Ask("GET", "/v1/trees");
  EXPECT_EQ(RunningService::CodeOf(refused), "draining");
  EXPECT_NE(refused.Header("retry-after"), "");
  backend_.hold = false;
  EXPECT_EQ(busy.Read()->status, 200);
  EXPECT_TRUE(running_.server().WaitUntilIdle(std::chrono::steady_clock::now() + 5s));
}

TEST_F(SmallService, AnswersAtTheLimitsAndRefusesBeyond) {
  EXPECT_EQ(running_.Ask("POST", "/v1/trees", std::string(100, 'm')).status, 201);
  EXPECT_EQ(running_.Code("POST", "/v1/trees", std::string(101, 'm')), "mesh_too_large");
  EXPECT_EQ(running_.Ask("POST", Tree("/rays/any"), NpyRays(std::vector<float>(18, 1))).status,
            200);
  EXPECT_EQ(running_.Code("POST", Tree("/rays/any"), NpyRays(std::vector<float>(24, 1))),
            "too_many_rays");
  EXPECT_EQ(running_.Code("POST", Tree("/rays/any"),
                          "{\"rays\":[[1,1,1,1,1,1],[1,1,1,1,1,1],[1,1,1,1,1,1],[1,1,1,1,1,1]]}"),
            "too_many_rays");
  EXPECT_EQ(running_.Code("POST", Tree("/rays/any"), std::string(4096 + 3 * 200 + 1, ' ')),
            "body_too_large");
  EXPECT_EQ(running_.Ask("GET", Tree("/render.png?width=10&height=10")).status, 200);
  EXPECT_EQ(running_.Code("GET", Tree("/render.png?width=10&height=11")), "image_too_large");
  EXPECT_EQ(running_.Code("GET", Tree("/render.png?width=20000&height=1")), "image_too_large");
  EXPECT_EQ(running_.Ask("GET", Tree("/render.png?width=10&height=11&region=0,0,10,10")).status,
            200);
}

TEST_F(SmallService, QueuesAsManyAsItSaysAndRefusesTheRestAtOnce) {
  const std::string path = Tree("/rays/any");
  backend_.hold = true;
  // Bodies of nothing but a few bytes, so that only the queue is full, not the memory.
  RawClient running(running_.port()), queued(running_.port());
  const std::string cells = MakeRequest("GET", Tree("/cells?depth=1"));
  running.Send(cells);
  WaitFor([&] { return backend_.running == 1; });
  queued.Send(cells);
  std::this_thread::sleep_for(50ms);
  const auto start = std::chrono::steady_clock::now();
  const RawAnswer refused = running_.Ask("GET", Tree("/cells?depth=1"));
  EXPECT_LT(std::chrono::steady_clock::now() - start, 1s);
  EXPECT_EQ(refused.status, 503);
  EXPECT_EQ(RunningService::CodeOf(refused), "overloaded");
  EXPECT_EQ(refused.Header("retry-after"), "1");
  EXPECT_EQ(running_.Ask("GET", "/healthz").status, 200);
  backend_.hold = false;
  EXPECT_EQ(running.Read()->status, 200);
  const auto answer = queued.Read();
  ASSERT_TRUE(answer);
  EXPECT_EQ(answer->status, 200);
  const std::string timing = answer->Header("server-timing");
  EXPECT_GT(std::stod(timing.substr(timing.find("dur=") + 4)), 40) << timing;
  EXPECT_EQ(backend_.most_running, 1);
}

TEST_F(SmallService, RefusesBodiesThatDoNotFitIntoItsMemoryNow) {
  const std::string path = Tree("/rays/any");
  backend_.hold = true;
  RawClient first(running_.port());
  first.Send(MakeRequest("POST", path, kRays));
  WaitFor([&] { return backend_.running == 1; });
  const RawAnswer refused = running_.Ask("POST", path, kRays);
  EXPECT_EQ(refused.status, 503);
  EXPECT_EQ(RunningService::CodeOf(refused), "memory_full");
  EXPECT_NE(refused.Header("retry-after"), "");
  backend_.hold = false;
  EXPECT_EQ(first.Read()->status, 200);
  EXPECT_EQ(running_.Ask("POST", path, kRays).status, 200);
}

TEST_F(ServiceOverHttp, ABodyThatIsDeclaredAndDoesNotComeExcludesNobody) {
  const std::string path = Tree("/rays/any");
  // More than all memory of requests, and a few bytes of it.
  RawClient slow(running_.port());
  const std::string size = std::to_string(std::uint64_t{360} << 20);
  slow.Send("POST " + path + " HTTP/1.1\r\nHost: a\r\nContent-Length: " + size +
            "\r\n\r\n{\"rays\":[");
  RawClient slow_upload(running_.port());
  slow_upload.Send("POST /v1/trees HTTP/1.1\r\nHost: a\r\nContent-Length: " + size +
                   "\r\n\r\nOFF\n");
  WaitFor([&] { return running_.service().request_memory_used() > 0; });
  for (int i = 0; i < 50; ++i) {
    EXPECT_EQ(running_.Ask("POST", path, kRays).status, 200);
    EXPECT_EQ(running_.Ask("GET", Tree("/render.png?width=64&height=64")).status, 200);
  }
  slow.Send("[0,0");
  EXPECT_EQ(running_.Ask("POST", path, kRays).status, 200);
}

// Each byte of a body counts three: room for two bodies without their last five bytes.
class TightService : public ServiceOverHttp {
 protected:
  TightService() : ServiceOverHttp(Tight()) {}
  static ServiceOptions Tight() {
    ServiceOptions options;
    options.request_memory_bytes = 6 * std::string_view(kRays).size() - 30;
    return options;
  }
};

TEST_F(TightService, RefusesTheNewestBodyWhenItsMemoryIsFull) {
  const std::string path = Tree("/rays/any");
  const std::string_view rays = kRays;
  const auto begin = [&](RawClient& client, std::string_view first_bytes) {
    const std::uint64_t used = running_.service().request_memory_used();
    client.Send("POST " + path + " HTTP/1.1\r\nHost: a\r\nContent-Length: " +
                std::to_string(rays.size()) + "\r\n\r\n");
    client.Send(first_bytes);
    WaitFor(
        [&] { return running_.service().request_memory_used() == used + 3 * first_bytes.size(); });
  };
  RawClient older(running_.port()), newest(running_.port());
  begin(older, rays.substr(0, rays.size() - 10));
  begin(newest, rays.substr(0, rays.size() - 1));
  older.Send(rays.substr(rays.size() - 10));
  const auto answered = older.Read();
  ASSERT_TRUE(answered);
  EXPECT_EQ(answered->status, 200) << answered->body;
  newest.Send(rays.substr(rays.size() - 1));
  const auto refused = newest.Read();
  ASSERT_TRUE(refused);
  EXPECT_EQ(RunningService::CodeOf(*refused), "memory_full");
  EXPECT_EQ(running_.Ask("POST", path, kRays).status, 200);
}

}  // namespace
}  // namespace kdray::server
