// SPDX-License-Identifier: Apache-2.0
// Point queries over a real socket: forms, headers and refusals with a fake backend, and answers
// with the real one.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "server/core_backend.h"
#include "tests/integration/service_over_http.h"
#include "tests/support/npy_array.h"
#include "tests/support/obj_text.h"
#include "tests/support/service_fixture.h"
#include "tests/support/shapes.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/wait_until.h"

namespace kdray::server {
namespace {

using nlohmann::json;
using test::Json;
using test::NpyArray;
using test::RawAnswer;
using test::RunningService;
using testing::HasSubstr;

constexpr const char* kQueries[] = {"/points/closest", "/points/signed-distance", "/points/inside"};

std::string NpyData(const std::string& file) {
  const auto length =
      static_cast<unsigned char>(file[8]) + 256U * static_cast<unsigned char>(file[9]);
  return file.substr(10 + length);
}

using Points = ServiceOverHttp;

TEST_F(Points, AreAnsweredInTheFormOfTheRequestOrTheAcceptedOne) {
  const std::string tree = "/v1/trees/" + running_.Upload("mesh");
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  const std::string npy = NpyArray<float>({1, 2, 3, kNan, 0, 0}, 3);
  for (const char* query : kQueries) {
    const RawAnswer json_answer =
        running_.Ask("POST", tree + query, R"({"points": [[1, 2, 3], [0, 0, -1]]})");
    EXPECT_EQ(json_answer.status, 200) << json_answer.body;
    EXPECT_EQ(json_answer.Header("content-type"), "application/json");
    EXPECT_EQ(json_answer.Header("kdray-invalid"), "0");
    EXPECT_EQ(json_answer.Header("kdray-precision"), "double");
    EXPECT_EQ(json_answer.Header("vary"), "Accept");
    EXPECT_EQ(json_answer.Header("cache-control"), "no-store");
    EXPECT_THAT(json_answer.Header("server-timing"), HasSubstr("trace;dur="));
    EXPECT_EQ(Json(json_answer).at("results").size(), 2u);

    const RawAnswer npy_answer = running_.Ask("POST", tree + query, npy);
    EXPECT_EQ(npy_answer.status, 200);
    EXPECT_EQ(npy_answer.Header("content-type"), "application/x-npy");
    EXPECT_EQ(npy_answer.Header("kdray-invalid"), "1");
    const RawAnswer accepted =
        running_.Ask("POST", tree + query, npy, "Accept: application/json\r\n");
    EXPECT_EQ(Json(accepted).at("invalid"), json({1}));
    EXPECT_TRUE(Json(accepted).at("results").at(1).is_null());
    EXPECT_EQ(running_.Ask("POST", tree + query, R"({"points": []})").status, 200);
  }
}

TEST_F(Points, AreRefusedAsRaysAre) {
  const std::string tree = "/v1/trees/" + running_.Upload("mesh");
  const std::string body = R"({"points": [[1, 2, 3]]})";
  const std::string unknown = "/v1/trees/" + std::string(64, '0') + "-auto";
  for (const char* query : kQueries) {
    const std::string path = tree + query;
    EXPECT_EQ(running_.Code("POST", path, R"({"rays": []})"), "invalid_parameter");
    EXPECT_EQ(running_.Code("POST", path, "[1"), "invalid_json");
    EXPECT_EQ(running_.Code("POST", path, NpyArray<float>({1, 2, 3, 4, 5, 6}, 6)), "invalid_array");
    EXPECT_EQ(running_.Code("POST", path + "?precision=watertight", body), "invalid_parameter");
    EXPECT_EQ(running_.Code("POST", path + "?t_min=0", body), "invalid_parameter");
    EXPECT_EQ(running_.Code("POST", path + "?deadline_ms=0", body), "invalid_parameter");
    EXPECT_EQ(running_.Code("POST", path, body, "Content-Type: text/csv\r\n"),
              "unsupported_media_type");
    EXPECT_EQ(running_.Code("POST", path, body, "Accept: text/html\r\n"), "not_acceptable");
    EXPECT_EQ(running_.Code("POST", unknown + query, body), "tree_not_found");
    EXPECT_EQ(running_.Code("GET", path), "method_not_allowed");
    backend_.hold = true;
    EXPECT_EQ(running_.Code("POST", path + "?deadline_ms=30", body), "deadline_exceeded");
    backend_.hold = false;
  }
  EXPECT_EQ(running_.Code("POST", tree + "/points/inside?fields=u", body), "invalid_parameter");
  EXPECT_EQ(running_.Code("POST", tree + "/points/closest?fields=t", body), "invalid_parameter");
}

class RealPoints : public testing::Test {
 protected:
  RealPoints() {
    CoreBackendOptions options;
    options.data_dir = folder_.path() / "data";
    options.threads = 2;
    backend_ = MakeCoreBackend(options).value();
    running_ = std::make_unique<RunningService>(*backend_);
  }
  ~RealPoints() override {
    running_.reset();
    backend_.reset();
  }
  json Ask(const std::string& path, const std::string& body) {
    const RawAnswer answer = running_->Ask("POST", "/v1/trees/" + path, body);
    EXPECT_EQ(answer.status, 200) << answer.body;
    return Json(answer);
  }

  const test::TemporaryFolder folder_;
  std::unique_ptr<Backend> backend_;
  std::unique_ptr<RunningService> running_;
};

TEST_F(RealPoints, AreThoseOfTheMeshInEveryBuildAndPrecision) {
  const std::string cube = test::ObjText(test::Cube({0, 0, 0}, 1));
  const std::string body = R"({"points": [[0.5, 0.25, 3], [0.75, 0, 0], [1, 1, 1], [9, 0, 0]]})";
  for (const char* build : {"kd-sah", "kd-median", "bvh", "box"}) {
    const std::string id = running_->Upload(cube, std::string("?build=") + build);
    for (const char* precision : {"auto", "double", "exact"}) {
      const std::string options = std::string("?precision=") + precision;
      EXPECT_EQ(Ask(id + "/points/closest" + options + "&fields=distance,point", body)["results"],
                json::parse(R"([{"distance": 2, "point": [0.5, 0.25, 1]},
                                {"distance": 0.25, "point": [1, 0, 0]},
                                {"distance": 0, "point": [1, 1, 1]},
                                {"distance": 8, "point": [1, 0, 0]}])"));
      EXPECT_EQ(Ask(id + "/points/closest" + options + "&fields=normal",
                    R"({"points": [[0.5, 0.25, 3]]})")["results"],
                json::parse(R"([{"normal": [0, 0, 1]}])"));
      EXPECT_EQ(Ask(id + "/points/signed-distance" + options, body)["results"],
                json({2, -0.25, 0, 8}));
      EXPECT_EQ(Ask(id + "/points/inside" + options, body)["results"],
                json({false, true, true, false}));
    }
  }
}

TEST_F(RealPoints, BuildNothingMoreThanRaysNeed) {
  const std::string id = running_->Upload(test::ObjText(test::IcoSphere({0, 0, 0}, 1, 3)));
  const BackendCounters before = backend_->counters();
  for (const char* query : kQueries) Ask(id + query, R"({"points": [[0, 0, 0], [3, 0, 0]]})");
  const BackendCounters after = backend_->counters();
  EXPECT_EQ(after.builds, before.builds);
  EXPECT_EQ(after.binary_rebuilds, 0u);
  // The build may have held more when it answered.
  EXPECT_TRUE(
      test::WaitUntil([&] { return backend_->counters().memory_bytes <= before.memory_bytes; }));
}

TEST_F(RealPoints, OfAnOpenMeshAreUnknown) {
  // A square and a point within its bounds' corners but not on its one triangle.
  const std::string id = running_->Upload("v 0 0 0\nv 1 0 0\nv 0 1 1\nf 1 2 3\n");
  const std::string body = R"({"points": [[0.25, 0.25, 0.75], [5, 5, 5], [0, 0, 0]]})";
  const json inside = Ask(id + "/points/inside", body)["results"];
  EXPECT_EQ(inside[1], false);
  EXPECT_EQ(inside[2], true);
  const json distances = Ask(id + "/points/signed-distance", body)["results"];
  EXPECT_EQ(distances[0].is_null(), inside[0].is_null());
  EXPECT_GT(distances[1], 0);
  EXPECT_EQ(distances[2], 0);
}

TEST_F(RealPoints, HaveTheRequestsShapeAndTypeInArrays) {
  const std::string id = running_->Upload(test::ObjText(test::Cube({0, 0, 0}, 1)));
  const RawAnswer answer = running_->Ask("POST", "/v1/trees/" + id + "/points/signed-distance",
                                         NpyArray<float>({0, 0, 3, 0, 0, 0.5F}, 3));
  ASSERT_EQ(answer.status, 200) << answer.body;
  EXPECT_EQ(answer.Header("kdray-precision"), "double");
  const float expected[] = {2, -0.5F};
  EXPECT_EQ(NpyData(answer.body), std::string(reinterpret_cast<const char*>(expected), 8));
  const RawAnswer exact = running_->Ask("POST", "/v1/trees/" + id + "/points/inside",
                                        NpyArray<double>({0, 0, 3, 0, 0, 0.5}, 3));
  EXPECT_EQ(exact.Header("kdray-precision"), "exact");
  EXPECT_EQ(NpyData(exact.body), std::string("\0\1", 2));
}

}  // namespace
}  // namespace kdray::server
