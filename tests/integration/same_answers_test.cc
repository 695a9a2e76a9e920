// SPDX-License-Identifier: Apache-2.0
// N20 over HTTP: JSON or npy, in one batch or row by row, from a tree just built, in memory or read
// from disk, on one thread or four: the same numbers, bit for bit.
// tests/property/same_bytes_test.cc has the rest of N20.
#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <memory>
#include <string>
#include <vector>

#include "api/names.h"
#include "server/core_backend.h"
#include "tests/support/npy_array.h"
#include "tests/support/obj_text.h"
#include "tests/support/seed.h"
#include "tests/support/service_fixture.h"
#include "tests/support/shapes.h"
#include "tests/support/temporary_folder.h"

namespace kdray::server {
namespace {

using nlohmann::json;
using test::Json;
using test::RawAnswer;
using test::RunningService;

/// A row of an answer: `t`, `u` and `v` as bits; a miss is all the same.
struct Row {
  std::uint64_t t = 0, u = 0, v = 0;
  std::int64_t triangle = -1;
  friend bool operator==(const Row&, const Row&) = default;
};

std::vector<Row> RowsFromJson(const std::string& body) {
  std::vector<Row> rows;
  const json answer = json::parse(body);
  for (const json& hit : answer.at("results")) {
    rows.emplace_back();
    if (hit.is_null()) continue;
    const auto bits = [&](const char* name) {
      return std::bit_cast<std::uint64_t>(hit.at(name).get<double>());
    };
    rows.back() = {bits("t"), bits("u"), bits("v"), hit.at("triangle").get<std::int64_t>()};
  }
  return rows;
}

/// Of `t`, `triangle`, `u`, `v`, eight bytes each.
std::vector<Row> RowsFromNpy(const std::string& file) {
  const auto header =
      static_cast<unsigned char>(file.at(8)) + 256U * static_cast<unsigned char>(file.at(9));
  std::vector<Row> rows;
  for (std::size_t at = 10 + header; at < file.size(); at += 32) {
    std::uint64_t t = 0, u = 0, v = 0;
    std::int64_t triangle = 0;
    std::memcpy(&t, &file[at], 8);
    std::memcpy(&triangle, &file[at + 8], 8);
    std::memcpy(&u, &file[at + 16], 8);
    std::memcpy(&v, &file[at + 24], 8);
    rows.push_back(triangle < 0 ? Row{} : Row{t, u, v, triangle});
  }
  return rows;
}

/// From inside a sphere at its vertices, from around it anywhere; one invalid ray.
std::vector<double> RayNumbers(const core::MeshData& data) {
  auto engine = test::RandomEngine(2050);
  std::uniform_real_distribution<double> uniform(-1.5, 1.5);
  std::vector<double> numbers;
  for (int i = 0; i < 400; ++i) {
    const core::Vec3d origin = i % 2 == 0
                                   ? core::Vec3d{0.01, 0.02, 0.03}
                                   : core::Vec3d{uniform(engine), uniform(engine), uniform(engine)};
    const core::Vec3d direction = data.vertices[engine() % data.vertices.size()] - origin;
    for (const double n : {origin.x, origin.y, origin.z, direction.x, direction.y, direction.z})
      numbers.push_back(n);
  }
  for (int i = 0; i < 6; ++i) numbers.push_back(0);
  return numbers;
}

/// Rows [first, first + count) of six numbers each, shortest text.
std::string JsonBatch(const std::vector<double>& numbers, std::size_t first, std::size_t count) {
  json rays = json::array();
  for (std::size_t i = first; i < first + count; ++i)
    rays.push_back(std::vector<double>(numbers.begin() + static_cast<std::ptrdiff_t>(6 * i),
                                       numbers.begin() + static_cast<std::ptrdiff_t>(6 * i + 6)));
  return json{{"rays", rays}}.dump();
}

TEST(N20SameBytes, TheFormOfTheRequestAndWhereTheTreeWasChangeNoBit) {
  const core::MeshData data = test::BumpySphere({0, 0, 0}, 1, 16, 24, 0.3);
  const std::string mesh = test::ObjText(data);
  const std::vector<double> numbers = RayNumbers(data);
  const std::size_t count = numbers.size() / 6;
  const std::string npy = test::NpyArray(numbers, 6);

  const test::TemporaryFolder folder;
  std::map<std::string, std::vector<Row>> want;  // by precision
  for (const bool from_disk : {false, true}) {
    CoreBackendOptions options;
    options.data_dir = folder.path() / "data";
    options.threads = from_disk ? 4 : 1;
    const auto backend = MakeCoreBackend(options).value();
    RunningService running(*backend);
    for (const std::string build : {"kd-sah", "bvh"}) {
      const std::string path =
          "/v1/trees/" + running.Upload(mesh, "?build=" + build) + "/rays/closest";
      for (const std::string precision : {"fast", "watertight", "double", "exact"}) {
        const std::string query = path + "?precision=" + precision;
        for (int use = 0; use < 2; ++use) {
          const RawAnswer from_json = running.Ask("POST", query, JsonBatch(numbers, 0, count));
          ASSERT_EQ(from_json.status, 200) << from_json.body;
          const std::vector<Row> rows = RowsFromJson(from_json.body);
          ASSERT_EQ(rows.size(), count);
          if (want.count(precision) == 0) want[precision] = rows;
          EXPECT_EQ(rows, want[precision]) << build << ", " << precision;
          const RawAnswer from_npy = running.Ask("POST", query, npy);
          ASSERT_EQ(from_npy.status, 200) << from_npy.body;
          EXPECT_EQ(RowsFromNpy(from_npy.body), want[precision]) << build << ", " << precision;
        }
        for (std::size_t i = 0; i < count; i += 40) {
          const RawAnswer one = running.Ask("POST", query, JsonBatch(numbers, i, 1));
          EXPECT_EQ(RowsFromJson(one.body), std::vector<Row>{want[precision][i]})
              << build << ", " << precision << ", row " << i;
        }
      }
    }
    EXPECT_EQ(backend->counters().loads, from_disk ? 2u : 0u);
    backend->Shutdown();
  }
}

}  // namespace
}  // namespace kdray::server
