// SPDX-License-Identifier: Apache-2.0
// N24: JSON numbers at the edges of double, in and out of the service. The readers' own tests
// (tests/unit/api) have more of them.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <charconv>
#include <cmath>
#include <limits>
#include <string>

#include "server/core_backend.h"
#include "tests/support/obj_text.h"
#include "tests/support/service_fixture.h"
#include "tests/support/shapes.h"
#include "tests/support/temporary_folder.h"

namespace kdray::server {
namespace {

using nlohmann::json;
using test::Json;
using test::RawAnswer;
using test::RunningService;
using testing::HasSubstr;

class N24JsonNumbers : public testing::Test {
 protected:
  N24JsonNumbers() {
    CoreBackendOptions options;
    options.data_dir = folder_.path() / "data";
    backend_ = MakeCoreBackend(options).value();
    running_ = std::make_unique<RunningService>(*backend_);
    // The sides of the box are at 3, at a third, and at 2^53.
    core::MeshData box = test::Cube({0, 0, 0}, 1);
    for (core::Vec3d& v : box.vertices)
      v = {v.x < 0 ? -9007199254740992.0 : 3, v.y < 0 ? -1.0 : 1.0 / 3, v.z < 0 ? -1e-300 : 1};
    path_ = "/v1/trees/" + running_->Upload(test::ObjText(box)) + "/rays/closest";
  }
  ~N24JsonNumbers() override {
    running_.reset();
    backend_->Shutdown();
  }
  RawAnswer Ask(const std::string& ray, const std::string& query = "") {
    return running_->Ask("POST", path_ + query, "{\"rays\":[" + ray + "]}");
  }

  test::TemporaryFolder folder_;
  std::unique_ptr<Backend> backend_;
  std::unique_ptr<RunningService> running_;
  std::string path_;
};

TEST_F(N24JsonNumbers, NumbersBeyondDoubleAndKeysThatStandTwiceAreInvalidJson) {
  for (const char* ray : {"[1e999,0,0,1,0,0]", "[0,0,0,-1e999,0,0]", "[0,0,0,1,0,0,0,1e309]"}) {
    EXPECT_EQ(RunningService::CodeOf(Ask(ray)), "invalid_json") << ray;
  }
  EXPECT_EQ(running_->Code("POST", path_, R"({"rays":[],"rays":[]})"), "invalid_json");
}

TEST_F(N24JsonNumbers, NumbersBeyondFloatAreAnswered) {
  for (const char* precision : {"fast", "watertight", "double", "exact"}) {
    const std::string query = std::string("?precision=") + precision;
    // From 1e39 away along x; in steps of 1e39 along the direction; a t_max of 1e39.
    for (const char* ray :
         {"[1e39,0,0.5,-1,0,0]", "[0,0,0.5,1e39,0,0]", "[0,0,0.5,1,0,0,0,1e39]"}) {
      const RawAnswer answer = Ask(ray, query);
      ASSERT_EQ(answer.status, 200) << answer.body;
      const json hit = Json(answer).at("results").at(0);
      ASSERT_TRUE(hit.is_object()) << precision << ", " << ray;
      EXPECT_TRUE(std::isfinite(hit.at("t").get<double>()));
    }
  }
}

TEST_F(N24JsonNumbers, EveryDigitCountsThatDoubleHas) {
  for (const char* precision : {"double", "exact"}) {
    const std::string query = std::string("?precision=") + precision;
    // 2^53 + 1 is no double and is read as 2^53: from the middle of the box to its side there.
    const json from = Json(Ask("[-9007199254740993,0,0.5,1,0,0,0,null]", query));
    EXPECT_EQ(from.at("results").at(0).at("t"), 0) << precision;
    // Zeros of both signs, and what rounds to zero, are one.
    const std::string zero = Ask("[0,0,0.5,1,0,0]", query).body;
    EXPECT_EQ(Ask("[-0.0,-0,0.5,1,-0.0,0]", query).body, zero) << precision;
    EXPECT_EQ(Ask("[1e-400,-1e-400,0.5,1,1e-400,0]", query).body, zero) << precision;
  }
}

TEST_F(N24JsonNumbers, AnswersAreTheShortestTextThatReadsBackTheSame) {
  const std::string body = Ask("[0,0,0.5,0,1,0]", "?precision=exact").body;
  char text[32];
  const auto end = std::to_chars(text, text + sizeof text, 1.0 / 3);
  EXPECT_THAT(body, HasSubstr("\"t\":" + std::string(text, end.ptr))) << body;
  EXPECT_EQ(json::parse(body).at("results").at(0).at("t").get<double>(), 1.0 / 3);
  EXPECT_THAT(body, testing::Not(HasSubstr("-0"))) << body;
}

}  // namespace
}  // namespace kdray::server
