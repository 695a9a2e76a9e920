// SPDX-License-Identifier: Apache-2.0
// Visibility over a real socket: forms and refusals with a fake backend, and
// answers with the real one.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <limits>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "core/intersect/hit_filter.h"
#include "core/trace/trace.h"
#include "server/core_backend.h"
#include "tests/integration/service_over_http.h"
#include "tests/support/npy_array.h"
#include "tests/support/obj_text.h"
#include "tests/support/scenes.h"
#include "tests/support/seed.h"
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

std::string NpyData(const std::string& file) {
  const auto length =
      static_cast<unsigned char>(file[8]) + 256U * static_cast<unsigned char>(file[9]);
  return file.substr(10 + length);
}
std::string NpyShape(const std::string& file) {
  const std::size_t at = file.find("'shape': (");
  return file.substr(at + 9, file.find(')', at) - at - 8);
}

using Visibility = ServiceOverHttp;

TEST_F(Visibility, IsAMatrixOfBytesOrBits) {
  const std::string path = Tree("/visibility");
  const RawAnswer answer = running_.Ask(
      "POST", path, R"({"from": [[0,0,1],[0,0,-1]], "to": [[0,0,2],[1,0,-3],[0,1,1]]})");
  ASSERT_EQ(answer.status, 200) << answer.body;
  EXPECT_EQ(Json(answer), json::parse(R"({"visible": [[true,false,true],[false,true,false]],
                                          "invalid": []})"));
  EXPECT_EQ(answer.Header("kdray-offset"), "0.25");
  EXPECT_EQ(answer.Header("kdray-invalid"), "0");
  EXPECT_THAT(answer.Header("server-timing"), HasSubstr("trace;dur="));

  const std::string npy = NpyArray<float>({0, 0, 1, 0, 0, -1, 0, 0, 2, 1, 0, -3, 0, 1, 1}, 3);
  const RawAnswer bytes = running_.Ask("POST", path + "?from_count=2", npy);
  ASSERT_EQ(bytes.status, 200) << bytes.body;
  EXPECT_THAT(bytes.body, HasSubstr("'|b1'"));
  EXPECT_EQ(NpyShape(bytes.body), "(2, 3)");
  EXPECT_EQ(NpyData(bytes.body), std::string("\1\0\1\0\1\0", 6));
  const RawAnswer bits = running_.Ask("POST", path + "?from_count=2&bits=true", npy);
  EXPECT_THAT(bits.body, HasSubstr("'|u1'"));
  EXPECT_EQ(NpyShape(bits.body), "(2, 1)");
  EXPECT_EQ(NpyData(bits.body), std::string("\xa0\x40", 2));

  EXPECT_EQ(Json(running_.Ask("POST", path, R"({"from": [], "to": [[0,0,1]]})"))["visible"],
            json::array());
  EXPECT_EQ(Json(running_.Ask("POST", path, R"({"to": [], "from": [[0,0,1]]})"))["visible"],
            json::array({json::array()}));
  const RawAnswer none = running_.Ask("POST", path + "?from_count=5&bits=true", npy);
  EXPECT_EQ(NpyShape(none.body), "(5, 0)");
}

TEST_F(Visibility, IsRefusedByParameterAndPlace) {
  const std::string path = Tree("/visibility");
  const std::string sets = R"({"from": [[0,0,1]], "to": [[0,0,2]]})";
  const std::string npy = NpyArray<float>({0, 0, 1, 0, 0, -1}, 3);
  EXPECT_EQ(running_.Code("POST", path, npy), "invalid_parameter");
  EXPECT_EQ(running_.Code("POST", path + "?from_count=3", npy), "invalid_parameter");
  EXPECT_EQ(running_.Code("POST", path + "?from_count=1", sets), "invalid_parameter");
  EXPECT_EQ(running_.Code("POST", path + "?bits=true", sets), "invalid_parameter");
  EXPECT_EQ(running_.Code("POST", path + "?bits=1", sets), "invalid_parameter");
  EXPECT_EQ(running_.Code("POST", path + "?t_min=-1", sets), "invalid_parameter");
  EXPECT_EQ(running_.Code("POST", path + "?t_max=inf", sets), "invalid_parameter");
  EXPECT_EQ(running_.Code("POST", path + "?t_min=0.5&t_max=0.25", sets), "invalid_parameter");
  EXPECT_EQ(running_.Code("POST", path + "?to_directions=true&t_max=1", sets), "invalid_parameter");
  EXPECT_EQ(running_.Code("POST", path, R"({"from": [[0,0,1]]})"), "invalid_json");
  EXPECT_EQ(running_.Code("POST", path, R"({"from": [[0,0,1]], "to": [[0,0]]})"), "invalid_json");
  EXPECT_EQ(running_.Code("POST", path, R"({"points": []})"), "invalid_parameter");
  EXPECT_EQ(running_.Code("POST", path + "?from_count=1", NpyArray<float>({1, 2}, 2)),
            "invalid_array");
}

class NarrowVisibility : public ServiceOverHttp {
 protected:
  NarrowVisibility() : ServiceOverHttp(SixRays()) {}

 private:
  static ServiceOptions SixRays() {
    ServiceOptions options;
    options.limits.max_rays = 6;
    return options;
  }
};

TEST_F(NarrowVisibility, CountsPairsAgainstTheLimitOfRays) {
  const std::string path = Tree("/visibility?from_count=2");
  EXPECT_EQ(running_.Code("POST", path, NpyArray<float>(std::vector<float>(15), 3)), "200");
  EXPECT_EQ(running_.Code("POST", path, NpyArray<float>(std::vector<float>(18), 3)),
            "too_many_rays");
  // One and six make six pairs of seven points.
  EXPECT_EQ(running_.Code("POST", Tree("/visibility?from_count=1"),
                          NpyArray<float>(std::vector<float>(21), 3)),
            "200");
}

class RealVisibility : public testing::Test {
 protected:
  RealVisibility() {
    CoreBackendOptions options;
    options.data_dir = folder_.path() / "data";
    options.threads = 2;
    backend_ = MakeCoreBackend(options).value();
    running_ = std::make_unique<RunningService>(*backend_);
  }
  ~RealVisibility() override {
    running_.reset();
    backend_.reset();
  }
  RawAnswer Ask(const std::string& path, const std::string& body) {
    const RawAnswer answer = running_->Ask("POST", "/v1/trees/" + path, body);
    EXPECT_EQ(answer.status, 200) << answer.body;
    return answer;
  }

  const test::TemporaryFolder folder_;
  std::unique_ptr<Backend> backend_;
  std::unique_ptr<RunningService> running_;
};

TEST_F(RealVisibility, IsThatOfRaysWithBothEndsOffTheSurface) {
  const core::MeshData mesh = test::BumpySphere({0, 0, 0}, 1, 12, 16, 0.3);
  const std::string id = running_->Upload(test::ObjText(mesh));
  auto engine = test::RandomEngine(5200);
  std::uniform_real_distribution<double> uniform(-2, 2);
  std::vector<double> points;  // every other one is a vertex
  constexpr std::size_t kFrom = 40, kTo = 50;
  for (std::size_t i = 0; i < kFrom + kTo; ++i) {
    const core::Vec3d& v = mesh.vertices[engine() % mesh.vertices.size()];
    for (int axis = 0; axis < 3; ++axis) {
      points.push_back(i % 2 == 0 ? v[axis] : uniform(engine));
    }
  }
  const core::Scene scene = test::MakeScene(mesh);
  std::vector<core::Ray> rays;
  const auto point = [&](std::size_t i) {
    return core::Vec3d{points[3 * i], points[3 * i + 1], points[3 * i + 2]};
  };
  for (std::size_t i = 0; i < kFrom; ++i) {
    for (std::size_t j = 0; j < kTo; ++j) {
      rays.push_back({point(i), 0, point(kFrom + j) - point(i), 1});
    }
  }
  for (const core::Precision precision : {core::Precision::kDouble, core::Precision::kExact}) {
    core::TraceOptions trace;
    trace.precision = precision;
    trace.cull = precision == core::Precision::kExact ? core::Cull::kBack : core::Cull::kNone;
    trace.starts_on_surface = trace.ends_on_surface = true;
    trace.surface_offset = core::SurfaceOffset(*scene.mesh, precision, false);
    std::vector<std::uint8_t> occluded(rays.size());
    ASSERT_TRUE(core::TraceAny(scene, std::span<const core::Ray>(rays), trace, occluded).ok());
    std::string expected;
    for (std::size_t i = 0; i < rays.size(); ++i) {
      const bool coincident = rays[i].direction == core::Vec3d{};
      expected += coincident || occluded[i] == 0 ? '\1' : '\0';
    }
    const std::string options = "precision=" + std::string(core::Name(precision)) +
                                "&cull=" + std::string(core::Name(trace.cull));
    const RawAnswer visible =
        Ask(id + "/visibility?from_count=40&" + options, NpyArray<double>(points, 3));
    EXPECT_EQ(NpyData(visible.body), expected) << options;
    EXPECT_EQ(std::stod(visible.Header("kdray-offset")), trace.surface_offset);
    EXPECT_GT(std::count(expected.begin(), expected.end(), 1), 200);
    const RawAnswer bits =
        Ask(id + "/visibility?from_count=40&bits=true&" + options, NpyArray<double>(points, 3));
    const std::string packed = NpyData(bits.body);
    for (std::size_t pair = 0; pair < kFrom * kTo; ++pair) {
      const std::size_t row = pair / kTo, column = pair % kTo;
      const auto byte = static_cast<unsigned char>(packed[row * 7 + column / 8]);
      ASSERT_EQ(byte >> (7 - column % 8) & 1, expected[pair]);
    }
  }
}

TEST_F(RealVisibility, OfCoincidentAndInvalidPointsAndOfDirections) {
  const std::string id = running_->Upload(test::ObjText(test::Cube({0, 0, 0}, 1)));
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  const RawAnswer answer =
      Ask(id + "/visibility?from_count=2",
          NpyArray<double>({2, 2, 2, kNan, 0, 0, 2, 2, 2, -2, -2, -2, 0, 0, kNan}, 3));
  EXPECT_EQ(NpyData(answer.body), std::string("\1\0\0\0\0\0", 6));
  EXPECT_EQ(answer.Header("kdray-invalid"), "2");
  const json results =
      Json(Ask(id + "/visibility?to_directions=true",
               R"({"from": [[0, 0, 3], [0, 0, 0]], "to": [[0, 0, 1], [0, 0, -1], [0, 0, 0]]})"));
  EXPECT_EQ(results["visible"], json::parse("[[true, false, false], [false, false, false]]"));
  EXPECT_EQ(results["invalid"], json({4}));
}

}  // namespace
}  // namespace kdray::server
