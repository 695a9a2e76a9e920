// SPDX-License-Identifier: Apache-2.0
#include "server/routes.h"

#include <gtest/gtest.h>

#include <string>

namespace kdray::server {
namespace {

RouteMatch Find(std::string_view method, std::string_view path) {
  return FindRoute(Routes(), method, path);
}

TEST(Routes, AnswerEveryPathOfTheContract) {
  for (const auto& [method, path] : {std::pair("GET", "/"),
                                     std::pair("GET", "/healthz"),
                                     std::pair("GET", "/readyz"),
                                     std::pair("GET", "/openapi.json"),
                                     std::pair("GET", "/docs"),
                                     std::pair("GET", "/problems/internal"),
                                     std::pair("GET", "/v1"),
                                     std::pair("GET", "/v1/trees"),
                                     std::pair("POST", "/v1/trees"),
                                     std::pair("GET", "/v1/trees/x"),
                                     std::pair("DELETE", "/v1/trees/x"),
                                     std::pair("GET", "/v1/trees/x/mesh"),
                                     std::pair("POST", "/v1/trees/x/rays/closest"),
                                     std::pair("POST", "/v1/trees/x/rays/any"),
                                     std::pair("GET", "/v1/trees/x/render.png"),
                                     std::pair("POST", "/v1/trees/x/render.png"),
                                     std::pair("GET", "/v1/trees/x/render.npy"),
                                     std::pair("POST", "/v1/trees/x/render.npy"),
                                     std::pair("GET", "/v1/trees/x/cells"),
                                     std::pair("POST", "/v1/trees/x/tradeoff"),
                                     std::pair("GET", "/v1/trees/x/tradeoff"),
                                     std::pair("DELETE", "/v1/trees/x/tradeoff")}) {
    EXPECT_NE(Find(method, path).handler, nullptr) << method << path;
  }
}

TEST(Routes, LetHeadGoWhereGetGoes) {
  for (const Route& route : Routes()) {
    EXPECT_EQ(Find("HEAD", route.path).handler, route.get) << route.path;
  }
}

TEST(Routes, NameWhatStandsForTheBraces) {
  EXPECT_EQ(Find("GET", "/v1/trees/abc-auto").path_parameter, "abc-auto");
  EXPECT_EQ(Find("POST", "/v1/trees/a%2Fb/rays/any").path_parameter, "a%2Fb");
  EXPECT_EQ(Find("GET", "/v1/trees").path_parameter, "");
}

TEST(Routes, KnowNoOtherPath) {
  for (const char* path : {"",
                           "*",
                           "//",
                           "/v1/",
                           "/v2",
                           "/V1",
                           "/v1/trees/",
                           "/v1/trees//mesh",
                           "/v1/trees/x/",
                           "/v1/trees/x/mesh/",
                           "/v1/trees/x/rays",
                           "/v1/trees/x/rays/closest/y",
                           "/v1/trees/x/y",
                           "/v1//trees",
                           "/./v1",
                           "/v1/../v1",
                           "/%76%31",
                           "/problems",
                           "/problems/",
                           "v1",
                           "/v1/trees/x/points/nearest",
                           "/metrics/"}) {
    EXPECT_EQ(Find("GET", path).route, nullptr) << path;
  }
}

TEST(Routes, TellAWrongMethodFromAWrongPath) {
  const RouteMatch match = Find("PUT", "/v1/trees");
  ASSERT_NE(match.route, nullptr);
  EXPECT_EQ(match.handler, nullptr);
  EXPECT_EQ(Allow(*match.route), "GET, HEAD, POST");
  EXPECT_EQ(Allow(*Find("OPTIONS", "/v1/trees/x").route), "GET, HEAD, DELETE");
  EXPECT_EQ(Allow(*Find("GET", "/v1/trees/x/rays/any").route), "POST");
  EXPECT_EQ(Find("HEAD", "/v1/trees/x/rays/any").handler, nullptr);
}

TEST(Routes, NeedNoTokenForHealthReadinessAndThePageOnly) {
  for (const Route& route : Routes()) {
    const bool is_of_the_page = route.path == "/" || route.label == "/";
    const bool open = is_of_the_page || route.path == "/healthz" || route.path == "/readyz";
    EXPECT_EQ(route.open, open) << route.path;
    // Files, and nothing of the service, belong to the page.
    EXPECT_TRUE(!is_of_the_page || !route.path.starts_with("/v1")) << route.path;
  }
}

}  // namespace
}  // namespace kdray::server
