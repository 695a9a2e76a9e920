// SPDX-License-Identifier: Apache-2.0
// The contract with the real backend: what is uploaded is what is hit.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "api/names.h"
#include "server/core_backend.h"
#include "tests/support/mesh_files.h"
#include "tests/support/npy_array.h"
#include "tests/support/obj_text.h"
#include "tests/support/service_fixture.h"
#include "tests/support/shapes.h"
#include "tests/support/temporary_folder.h"

namespace kdray::server {
namespace {

using nlohmann::json;
using test::Json;
using test::NpyArray;
using test::RawAnswer;
using test::RunningService;
using testing::HasSubstr;

/// The bytes after a .npy header.
std::string NpyData(const std::string& file) {
  const auto length =
      static_cast<unsigned char>(file[8]) + 256U * static_cast<unsigned char>(file[9]);
  return file.substr(10 + length);
}

template <class T>
std::vector<T> Numbers(const std::string& bytes) {
  std::vector<T> numbers(bytes.size() / sizeof(T));
  std::memcpy(numbers.data(), bytes.data(), numbers.size() * sizeof(T));
  return numbers;
}

class RealBackend : public testing::Test {
 protected:
  RealBackend() {
    CoreBackendOptions options;
    options.data_dir = folder_.path() / "data";
    options.threads = 2;
    auto backend = MakeCoreBackend(options);
    EXPECT_TRUE(backend.ok()) << backend.error().message;
    backend_ = *std::move(backend);
    running_ = std::make_unique<RunningService>(*backend_);
  }
  ~RealBackend() override {
    running_.reset();
    backend_->Shutdown();
  }

  std::string UploadFile(const std::filesystem::path& path, const std::string& query = "") {
    const auto bytes = test::ReadFileBytes(path);
    return running_->Upload({reinterpret_cast<const char*>(bytes.data()), bytes.size()}, query);
  }

  test::TemporaryFolder folder_;
  std::unique_ptr<Backend> backend_;
  std::unique_ptr<RunningService> running_;
};

TEST_F(RealBackend, ShowsAPausingClientTheEndOfItsConnectionAfterEveryKindOfRequest) {
  HttpServerOptions http;
  http.idle_timeout = std::chrono::milliseconds(50);
  RunningService running(*backend_, {}, http);
  const std::string command = KDRAY_PYTHON " " KDRAY_SOURCE_DIR
                                           "/tests/integration/keep_alive_client.py "
                                           "http://127.0.0.1:" +
                              std::to_string(running.port()) + " 0.2";
  EXPECT_EQ(std::system(command.c_str()), 0);
}

TEST_F(RealBackend, AnswersRaysAtACube) {
  const std::string id = running_->Upload(test::ObjText(test::Cube({0, 0, 0}, 1)));
  const json tree = Json(running_->Ask("GET", "/v1/trees/" + id));
  EXPECT_EQ(tree.at("state"), "ready");
  EXPECT_EQ(tree.at("mesh").at("triangles"), 12);
  EXPECT_EQ(tree.at("mesh").at("health").at("closed"), true);
  EXPECT_EQ(tree.at("tree").at("build"), "box");
  EXPECT_EQ(tree.at("mesh").at("bounds").at("max"), json({1, 1, 1}));

  const std::string rays =
      R"({"rays":[[0.25,0.5,5,0,0,-1],[0.25,0.5,5,0,0,1],[0.25,0.5,5,0,0,-2,0,1],[0,0,0,0,0,0],[0.25,0.5,5,0,0,-1,0,null]]})";
  const RawAnswer answer = running_->Ask("POST", "/v1/trees/" + id + "/rays/closest", rays);
  ASSERT_EQ(answer.status, 200) << answer.body;
  const json object = Json(answer);
  EXPECT_EQ(object.at("results").at(0).at("t"), 4);
  EXPECT_TRUE(object.at("results").at(1).is_null());
  EXPECT_TRUE(object.at("results").at(2).is_null());
  EXPECT_TRUE(object.at("results").at(3).is_null());
  EXPECT_EQ(object.at("results").at(4), object.at("results").at(0));
  EXPECT_EQ(object.at("invalid"), json({3}));
  EXPECT_EQ(answer.Header("kdray-invalid"), "1");
  EXPECT_EQ(Json(running_->Ask("POST", "/v1/trees/" + id + "/rays/any", rays)).at("results"),
            json({true, false, false, false, true}));
}

TEST_F(RealBackend, GivesTheSameBytesForEveryBuildAndPrecisionForNone) {
  const std::string mesh = test::ObjText(test::BumpySphere({1, 2, 3}, 1, 12, 24, 0.3));
  const std::string sha = running_->Upload(mesh).substr(0, 64);
  std::vector<float> numbers;
  for (int i = 0; i < 2000; ++i) {
    const double angle = 0.1 * i, height = 2.0 * (i % 41) / 40 - 1;
    for (const double number : {1 + 5 * std::cos(angle), 2 + 5 * std::sin(angle), 3 + height,
                                -std::cos(angle), -std::sin(angle), -height * 0.2}) {
      numbers.push_back(static_cast<float>(number));
    }
  }
  const std::string rays = NpyArray(numbers, 6);
  std::string first;
  for (const std::string_view build : api::kBuildNames) {
    const RawAnswer made =
        running_->Ask("POST", "/v1/trees?mesh=" + sha + "&build=" + std::string(build));
    ASSERT_LE(made.status, 201) << made.body;
    const std::string path = "/v1/trees/" + Json(made).at("id").get<std::string>();
    const RawAnswer answer = running_->Ask("POST", path + "/rays/closest", rays);
    ASSERT_EQ(answer.status, 200) << answer.body;
    if (first.empty()) first = answer.body;
    EXPECT_EQ(answer.body, first) << build;
  }
  EXPECT_THAT(first, HasSubstr("'triangle'"));
}

TEST_F(RealBackend, SaysWhichPrecisionAnswersAndWhatAMeshOfDoublesLosesInTheOthers) {
  // A tenth is no float, so these vertices are kept as doubles.
  const std::string id = running_->Upload("v 0.1 0 0\nv 1 0.1 0\nv 0 1 0.1\nf 1 2 3\n");
  const std::string plan = Json(running_->Ask("GET", "/v1/trees/" + id)).at("plan");
  EXPECT_THAT(plan, HasSubstr("auto means double"));
  EXPECT_THAT(plan, HasSubstr("With watertight and fast, rays are answered on vertices rounded"));
  const std::string rays = R"({"rays":[[0.3,0.3,5,0,0,-1]]})";
  const std::string path = "/v1/trees/" + id + "/rays/closest";
  EXPECT_EQ(running_->Ask("POST", path, rays).Header("kdray-precision"), "double");
  for (const std::string precision : {"fast", "watertight", "double", "exact"}) {
    const RawAnswer answer = running_->Ask("POST", path + "?precision=" + precision, rays);
    EXPECT_EQ(answer.Header("kdray-precision"), precision) << answer.body;
    EXPECT_EQ(Json(answer).at("results").at(0).at("triangle"), 0) << precision;
  }
  const RawAnswer image = running_->Ask(
      "GET", "/v1/trees/" + id + "/render.npy?mode=triangle&width=8&height=8&precision=exact");
  EXPECT_EQ(image.status, 200) << image.body;
  EXPECT_EQ(image.Header("kdray-precision"), "exact");
}

TEST_F(RealBackend, RefinesAnImageUntilItsNoiseIsLowOrItsTimeIsOver) {
  const std::string id = running_->Upload(test::ObjText(test::IcoSphere({0, 0, 0}, 1, 3)));
  const std::string path = "/v1/trees/" + id + "/render.npy?width=64&height=48";
  const RawAnswer quiet = running_->Ask("GET", path + "&max_noise=0.02");
  ASSERT_EQ(quiet.status, 200) << quiet.body;
  EXPECT_EQ(quiet.Header("kdray-stopped"), "noise");
  EXPECT_LT(std::stod(quiet.Header("kdray-noise")), 0.02);
  EXPECT_GT(std::stod(quiet.Header("kdray-samples")), 16);
  EXPECT_EQ(running_->Ask("GET", path + "&max_noise=0.02").body, quiet.body);

  const RawAnswer limited = running_->Ask("GET", path + "&max_noise=0.0001&max_samples=20");
  EXPECT_EQ(limited.Header("kdray-stopped"), "done");
  const RawAnswer cut =
      running_->Ask("POST", "/v1/trees/" + id + "/render.png",
                    R"({"width":1000,"height":1000,"budget_ms":50,"max_noise":1e-9})");
  EXPECT_EQ(cut.Header("kdray-stopped"), "budget");
  EXPECT_EQ(cut.Header("cache-control"), "no-store");
  // Longer than the request may take; it still ends in time.
  const RawAnswer late =
      running_->Ask("GET", path + "&budget_ms=60000&max_noise=1e-9&deadline_ms=500");
  EXPECT_EQ(late.status, 200) << late.body;
  EXPECT_EQ(running_->Ask("GET", path + "&samples=3").Header("kdray-samples"), "3");
}

TEST_F(RealBackend, MeasuresWhatSpeedCostsInAccuracy) {
  const std::string id = running_->Upload(test::ObjText(test::Cube({0, 0, 0}, 1)));
  const std::string path = "/v1/trees/" + id + "/tradeoff";
  EXPECT_EQ(running_->Code("GET", path), "not_measured");

  // It takes some seconds, so this is still under way, and is stopped.
  ASSERT_EQ(running_->Ask("POST", path + "?wait_ms=0").status, 202);
  const RawAnswer under_way = running_->Ask("GET", path);
  EXPECT_EQ(under_way.status, 202);
  EXPECT_EQ(Json(under_way).at("state"), "measuring");
  EXPECT_LT(Json(under_way).at("progress"), 1);
  EXPECT_EQ(running_->Ask("DELETE", path).status, 204);
  EXPECT_EQ(running_->Code("GET", path), "not_measured");

  ASSERT_EQ(running_->Ask("POST", path + "?wait_ms=0").status, 202);
  // Queries go on meanwhile.
  EXPECT_EQ(
      running_->Ask("POST", "/v1/trees/" + id + "/rays/any", R"({"rays":[[0,0,5,0,0,-1]]})").status,
      200);
  const RawAnswer answer = running_->Ask("GET", path + "?wait_ms=60000");
  ASSERT_EQ(answer.status, 200) << answer.body;
  const json measured = Json(answer);
  EXPECT_EQ(measured.at("mesh"), json({{"triangles", 12}, {"closed", true}}));
  EXPECT_EQ(measured.at("conditions").at("threads"), 2);
  ASSERT_EQ(measured.at("results").size(), 24U);
  for (const json& row : measured.at("results")) {
    const std::string name =
        row.at("build").get<std::string>() + " " + row.at("precision").get<std::string>();
    EXPECT_EQ(row.at("differences").at("count"), 0) << name;
    EXPECT_GT(row.at("random").at("rays_per_s"), 0) << name;
    if (row.at("precision") == "fast") {
      EXPECT_GT(row.at("leaks").at("count"), 0) << name;
      continue;
    }
    EXPECT_EQ(row.at("leaks").at("count"), 0) << name;
    EXPECT_GT(row.at("leaks").at("below"), 0) << name;
    EXPECT_LE(row.at("t_error").at("max"), row.at("t_error").at("bound")) << name;
  }
  EXPECT_EQ(Json(running_->Ask("GET", path)), measured);
}

TEST_F(RealBackend, RendersWhatIsThere) {
  const std::string id = running_->Upload(test::ObjText(test::IcoSphere({0, 0, 0}, 1, 3)));
  const std::string path = "/v1/trees/" + id;
  const RawAnswer depth = running_->Ask(
      "GET", path +
                 "/render.npy?mode=depth&width=31&height=31&projection=orthographic&view_height=4"
                 "&eye=0,0,5&target=0,0,0");
  ASSERT_EQ(depth.status, 200) << depth.body;
  const auto depths = Numbers<float>(NpyData(depth.body));
  ASSERT_EQ(depths.size(), 31U * 31U);
  EXPECT_NEAR(depths[15 * 31 + 15], 4, 0.02);
  EXPECT_TRUE(std::isinf(depths[0]));

  const RawAnswer png = running_->Ask("GET", path + "/render.png?width=64&height=48&cells_depth=4");
  ASSERT_EQ(png.status, 200) << png.body;
  EXPECT_THAT(png.body, testing::StartsWith("\x89PNG\r\n\x1a\n"));
  EXPECT_EQ(
      running_->Ask("POST", path + "/render.png", R"({"width":64,"height":48,"cells_depth":4})")
          .body,
      png.body);
  const json cells = Json(running_->Ask("GET", path + "/cells?depth=3"));
  EXPECT_GT(cells.at("cells").size(), 1U);
}

TEST_F(RealBackend, LooksStraightDownAndUpWhenUpIsLeftOut) {
  // Nothing about it is symmetric, so that a turned or mirrored picture is another one.
  const std::string id = running_->Upload("v 0 0 0\nv 1 0.1 0\nv 0.2 0 0.7\nf 1 2 3\n");
  const std::string png = "/v1/trees/" + id + "/render.png";
  struct View {
    const char *eye, *target, *up;
  };
  for (const View& view :
       {View{"0.3,5,0.2", "0.3,0,0.2", "0,0,-1"}, View{"0.3,-5,0.2", "0.3,0,0.2", "0,0,1"},
        // The target is left out too: the middle of the bounds.
        View{"0.5,2,0.35", "", "0,0,-1"}, View{"0.5,-2,0.35", "", "0,0,1"}}) {
    for (const std::string projection : {"perspective", "orthographic"}) {
      std::string query = "?width=64&height=48&projection=" + projection + "&eye=" + view.eye;
      json body = {{"width", 64}, {"height", 48}, {"projection", projection}};
      body["eye"] = json::parse("[" + std::string(view.eye) + "]");
      if (*view.target != '\0') {
        query += "&target=" + std::string(view.target);
        body["target"] = json::parse("[" + std::string(view.target) + "]");
      }
      const RawAnswer left_out = running_->Ask("GET", png + query);
      ASSERT_EQ(left_out.status, 200) << query << "\n" << left_out.body;
      EXPECT_EQ(left_out.body, running_->Ask("GET", png + query + "&up=" + view.up).body) << query;
      EXPECT_EQ(left_out.body, running_->Ask("POST", png, body.dump()).body) << body;
      const RawAnswer depth =
          running_->Ask("GET", "/v1/trees/" + id + "/render.npy" + query + "&mode=depth");
      EXPECT_EQ(depth.status, 200) << depth.body;

      // A view along an `up` that was given is refused by its name, and 0,1,0 is given here.
      for (const std::string up : {"0,1,0", "0,-2,0"}) {
        const RawAnswer refused = running_->Ask("GET", png + query + "&up=" + up);
        EXPECT_EQ(refused.status, 400) << query << up;
        EXPECT_EQ(Json(refused).at("parameter"), "up");
        body["up"] = json::parse("[" + up + "]");
        EXPECT_EQ(Json(running_->Ask("POST", png, body.dump())).at("parameter"), "/up");
        body.erase("up");
      }
    }
  }
}

TEST_F(RealBackend, RefusesACameraThatCannotBe) {
  const std::string id = running_->Upload(test::ObjText(test::Cube({0, 0, 0}, 1)));
  EXPECT_EQ(running_->Code("GET", "/v1/trees/" + id + "/render.png?eye=0,0,0&target=0,0,0"),
            "invalid_parameter");
  EXPECT_EQ(
      running_->Code("GET", "/v1/trees/" + id + "/render.png?eye=0,5,0&target=0,0,0&up=0,1,0"),
      "invalid_parameter");
}

TEST_F(RealBackend, RefusesWrongInputAndGoesOn) {
  const std::string mesh = test::ObjText(test::Cube({0, 0, 0}, 1));
  const std::string id = running_->Upload(mesh);
  const std::string path = "/v1/trees/" + id;
  const std::string ply =
      "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
      "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
      "0 0 0\n1 0 0\n";
  const float nan = std::numeric_limits<float>::quiet_NaN();
  struct Case {
    std::string method, path, body;
    int status;
    std::string code;
  };
  const std::vector<Case> cases = {
      {"GET", "/v1/trees/" + std::string(64, '0') + "-auto", "", 404, "tree_not_found"},
      {"PUT", "/v1/trees", "x", 405, "method_not_allowed"},
      {"POST", path + "/rays/closest", "{\"rays\":[[0,0,5,0,0,-1]", 400, "invalid_json"},
      {"POST", path + "/rays/closest", "{\"rays\":[[0,0,5,0,0,-1]],\"max\":1}", 400,
       "invalid_parameter"},
      {"POST", path + "/rays/closest?precison=fast", "{\"rays\":[]}", 400, "invalid_parameter"},
      {"POST", path + "/rays/closest", NpyArray(std::vector<std::int32_t>{0, 0, 5, 0, 0, -1}, 6),
       400, "invalid_array"},
      {"POST", "/v1/trees", "", 422, "empty_mesh"},
      {"POST", "/v1/trees", ply, 422, "invalid_mesh"},
      {"POST", "/v1/trees", "certainly no mesh", 415, "unsupported_mesh_format"},
      {"POST", "/v1/trees", "v 0 0 0\nv 1 0 0\n", 422, "empty_mesh"},
      {"POST", path + "/points/nearest", "{}", 404, "not_found"},
      {"GET", path + "/tradeoffs", "", 404, "not_found"},
  };
  for (const Case& wrong : cases) {
    const RawAnswer answer = running_->Ask(wrong.method, wrong.path, wrong.body);
    EXPECT_EQ(answer.status, wrong.status) << wrong.path << "\n" << answer.body;
    EXPECT_EQ(RunningService::CodeOf(answer), wrong.code) << wrong.path << "\n" << answer.body;
  }
  // The place of the failure: the line after the last vertex.
  EXPECT_TRUE(Json(running_->Ask("POST", "/v1/trees", ply)).contains("line"));
  // An invalid row does not spoil the batch.
  const RawAnswer mixed =
      running_->Ask("POST", path + "/rays/any",
                    NpyArray(std::vector<float>{0, 0, 5, 0, 0, nan, 0.25F, 0.5F, 5, 0, 0, -1}, 6));
  EXPECT_EQ(mixed.status, 200);
  EXPECT_EQ(mixed.Header("kdray-invalid"), "1");
  EXPECT_EQ(NpyData(mixed.body), std::string("\0\1", 2));
  EXPECT_EQ(Json(running_->Ask("POST", "/v1/trees", mesh)).at("id"), id);
}

TEST_F(RealBackend, ForgetsATreeAndItsMesh) {
  const std::string id = running_->Upload(test::ObjText(test::Cube({0, 0, 0}, 1)));
  EXPECT_EQ(running_->Ask("DELETE", "/v1/trees/" + id).status, 204);
  EXPECT_EQ(running_->Code("GET", "/v1/trees/" + id), "tree_not_found");
  EXPECT_EQ(running_->Code("GET", "/v1/trees/" + id + "/mesh"), "tree_not_found");
  EXPECT_EQ(running_->Code("POST", "/v1/trees?mesh=" + id.substr(0, 64)), "mesh_not_found");
}

TEST_F(RealBackend, TakesAScan) {
  KDRAY_NEED_MESHES();
  const auto file = *test::MeshFolder() / "stanford_bunny_69k_ascii.ply";
  const std::string id = UploadFile(file);
  const json tree = Json(running_->Ask("GET", "/v1/trees/" + id));
  EXPECT_EQ(tree.at("mesh").at("triangles"), 69451);
  EXPECT_EQ(tree.at("tree").at("build"), "bvh");
  const RawAnswer mesh = running_->Ask("GET", "/v1/trees/" + id + "/mesh");
  const auto bytes = test::ReadFileBytes(file);
  ASSERT_EQ(mesh.body.size(), bytes.size());
  EXPECT_EQ(std::memcmp(mesh.body.data(), bytes.data(), bytes.size()), 0);

  // The picture of which triangle is seen where agrees with rays through the pixels' centres.
  const RawAnswer image = running_->Ask(
      "GET", "/v1/trees/" + id +
                 "/render.npy?mode=triangle&width=64&height=64"
                 "&projection=orthographic&view_height=0.2&eye=-0.02,0.11,1&target=-0.02,0.11,0");
  ASSERT_EQ(image.status, 200) << image.body;
  const auto seen = Numbers<std::int32_t>(NpyData(image.body));
  std::vector<double> rays;
  for (int row = 0; row < 64; ++row) {
    for (int column = 0; column < 64; ++column) {
      const double x = -0.02 + 0.2 * ((column + 0.5) / 64 - 0.5);
      const double y = 0.11 - 0.2 * ((row + 0.5) / 64 - 0.5);
      rays.insert(rays.end(), {x, y, 1, 0, 0, -1});
    }
  }
  const RawAnswer hits = running_->Ask(
      "POST", "/v1/trees/" + id + "/rays/closest?fields=triangle&dtype=f4", NpyArray(rays, 6));
  ASSERT_EQ(hits.status, 200) << hits.body;
  const auto hit = Numbers<std::int32_t>(NpyData(hits.body));
  ASSERT_EQ(hit.size(), seen.size());
  int different = 0, covered = 0;
  for (std::size_t i = 0; i < hit.size(); ++i) {
    different += hit[i] != seen[i] ? 1 : 0;
    covered += hit[i] >= 0 ? 1 : 0;
  }
  EXPECT_GT(covered, 500);
  // A ray made by the camera may differ in its last bits, and so in the triangle at an edge.
  EXPECT_LE(different, 4);
}

}  // namespace
}  // namespace kdray::server
