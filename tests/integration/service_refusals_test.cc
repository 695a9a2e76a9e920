// SPDX-License-Identifier: Apache-2.0
// The contract over a real socket: what requests may not say.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "tests/integration/service_over_http.h"

namespace kdray::server {
namespace {

using nlohmann::json;
using test::Json;
using test::RawAnswer;
using test::RunningService;

TEST_F(ServiceOverHttp, RefusesUnknownParametersEverywhere) {
  for (const auto& [method, path] :
       std::vector<std::pair<std::string, std::string>>{{"GET", "/v1"},
                                                        {"GET", "/healthz"},
                                                        {"GET", "/readyz"},
                                                        {"GET", "/metrics"},
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
                                                        {"POST", Tree("/rays/count")},
                                                        {"POST", Tree("/rays/all")},
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
      {"POST", Tree("/rays/count"), kRays, "t_min=auto&cull=front", {"fields=t", "max_hits=1"}},
      {"POST",
       Tree("/rays/all"),
       kRays,
       "max_hits=1024&fields=side",
       {"max_hits=0", "max_hits=1025", "cull=", "t_min=auto&t_max=-1"}},
      {"GET",
       Tree("/render.png"),
       "",
       "width=1&height=1",
       {"width=0", "width=-1", "width=x", "height=1.5", "width=1&width=1"}},
      {"GET", Tree("/render.png"), "", "mode=depth", {"mode=", "mode=wireframe", "mode=position"}},
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

}  // namespace
}  // namespace kdray::server
