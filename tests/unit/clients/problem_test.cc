// SPDX-License-Identifier: Apache-2.0
#include "kdray/problem.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/unit/clients/fake_service.h"

namespace kdray::client {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

TEST(Problem, ReadsEveryFieldOfTheContract) {
  const Problem problem = ParseProblem(
      422,
      test::ProblemJson(422, "invalid_mesh", "vertex 9 of 8",
                        R"({"line": 12, "parameter": "/rays/3", "limit": 8, "actual": 9.5})"),
      "from-header");
  EXPECT_EQ(problem.status, 422);
  EXPECT_EQ(problem.code, "invalid_mesh");
  EXPECT_EQ(problem.detail, "vertex 9 of 8");
  EXPECT_EQ(problem.request_id, "req-7");
  EXPECT_EQ(problem.line, 12u);
  EXPECT_EQ(problem.parameter, "/rays/3");
  EXPECT_EQ(problem.limit, 8);
  EXPECT_EQ(problem.actual, 9.5);
}

TEST(Problem, PutsCodeAndDetailFirstAndWhereToLookBelow) {
  const Problem problem = {.status = 422,
                           .code = "invalid_mesh",
                           .detail = "vertex 9 of 8",
                           .request_id = "req-7",
                           .limit = 1073741824,
                           .line = 12};
  EXPECT_EQ(FormatProblem(problem),
            "invalid_mesh: vertex 9 of 8\n  HTTP 422, line 12, limit 1073741824, request req-7");
}

TEST(Problem, TakesTheRequestIdFromTheHeaderWhenTheBodyHasNone) {
  EXPECT_EQ(ParseProblem(500, R"({"code":"internal","detail":"x"})", "from-header").request_id,
            "from-header");
}

TEST(Problem, SaysSoWhenTheAnswerIsNoProblemDocument) {
  for (const char* body : {"", "<html>502 Bad Gateway</html>", "[1,2]", "{}", "{\"code\":5}"}) {
    SCOPED_TRACE(body);
    const Problem problem = ParseProblem(502, body, "");
    EXPECT_EQ(problem.code, "");
    EXPECT_THAT(FormatProblem(problem), HasSubstr("HTTP 502 without saying why"));
  }
}

TEST(Problem, PassesOverFieldsOfTheWrongKind) {
  const Problem problem = ParseProblem(
      400, R"({"code":"invalid_json","detail":7,"title":"Bad","line":-3,"limit":"x"})", "");
  EXPECT_EQ(problem.detail, "Bad");
  EXPECT_FALSE(problem.line.has_value());
  EXPECT_FALSE(problem.limit.has_value());
}

TEST(Problem, LetsNoControlCharacterReachTheTerminal) {
  Problem problem;
  problem.code = "x";
  problem.detail = "\x1b[2Jgone\r\x7f\bover";
  const std::string text = FormatProblem(problem);
  EXPECT_THAT(text, Not(HasSubstr("\x1b")));
  EXPECT_THAT(text, HasSubstr("?[2Jgone???over"));
}

}  // namespace
}  // namespace kdray::client
