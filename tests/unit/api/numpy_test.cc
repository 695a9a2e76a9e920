// SPDX-License-Identifier: Apache-2.0
// What numpy writes is read here, and what is written here numpy reads. Skipped, with a message,
// where numpy is absent.

#include <gtest/gtest.h>
#include <unistd.h>

#include <array>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <limits>
#include <string>

#include "api/batch_codec.h"
#include "tests/support/ray_rows.h"
#include "tests/support/seed.h"
#include "tests/unit/api/answers.h"

namespace kdray::api {
namespace {

using enum RayField;

std::string ReadFile(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

class Numpy : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = testing::TempDir() + "kdray-numpy-XXXXXX";
    ASSERT_NE(mkdtemp(folder_.data()), nullptr);
    if (std::system(KDRAY_PYTHON " -c 'import numpy' 2>/dev/null") != 0) {
      GTEST_SKIP() << "this needs numpy (python3-numpy), which " KDRAY_PYTHON " does not have";
    }
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  static std::string Run(const std::string& arguments) {
    const std::string command =
        KDRAY_PYTHON " " KDRAY_SOURCE_DIR "/tests/unit/api/numpy_oracle.py " + arguments;
    std::FILE* pipe = popen(command.c_str(), "r");
    EXPECT_NE(pipe, nullptr);
    std::string out;
    std::array<char, 4096> buffer;
    while (std::size_t n = std::fread(buffer.data(), 1, buffer.size(), pipe)) {
      out.append(buffer.data(), n);
    }
    EXPECT_EQ(pclose(pipe), 0) << command;
    return out;
  }

  /// What numpy reads in each file, one after the other.
  std::string Dump(const std::vector<std::string>& files) const {
    std::string paths;
    for (std::size_t i = 0; i < files.size(); ++i) {
      const std::string path = folder_ + "/" + std::to_string(i) + ".npy";
      std::ofstream(path, std::ios::binary) << files[i];
      paths += " " + path;
    }
    return Run("dump" + paths);
  }

  std::string folder_;
};

void ExpectRows(const std::vector<test::RayRow<double>>& rows, const std::string& wanted,
                std::size_t columns, const std::string& name) {
  ASSERT_EQ(wanted.size(), rows.size() * columns * sizeof(double)) << name;
  for (std::size_t row = 0; row < rows.size(); ++row) {
    double n[8] = {0, 0, 0, 0, 0, 0, 0.5, 2};
    std::memcpy(n, wanted.data() + row * columns * sizeof(double), columns * sizeof(double));
    const test::RayRow<double>& r = rows[row];
    const double read[8] = {r.ox, r.oy, r.oz, r.dx, r.dy, r.dz, r.t_min, r.t_max};
    for (std::size_t c = 0; c < 8; ++c) {
      ASSERT_EQ(read[c], n[c]) << name << " row " << row << " column " << c;
    }
  }
}

TEST_F(Numpy, WritesArraysThatAreReadHere) {
  const int count = std::stoi(Run("write " + folder_ + " " + std::to_string(test::Seed())));
  ASSERT_GT(count, 300);
  RayOptions options;
  options.t_min = 0.5;
  options.t_max = 2;
  for (int i = 0; i < count; ++i) {
    const std::string name = folder_ + "/" + std::to_string(i);
    const std::string body = ReadFile(name + ".npy");
    const auto table = DecodeRays(body, BatchType::kNpy, options, Limits{});
    ASSERT_TRUE(table) << name << ": " << table.problem().detail;
    const std::string wanted = ReadFile(name + ".rows");
    const std::size_t columns =
        table->size() == 0 ? 6 : wanted.size() / sizeof(double) / table->size();
    ExpectRows(test::RowsOf(*table), wanted, columns, name);
  }
}

TEST_F(Numpy, ReadsTheAnswersThatAreWrittenHere) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  ClosestAnswer answer;
  answer.hits = {{0.5, 0.25, 0.125, 3}, {kInfinity, 0, 0, -1}, {kNaN, 0, 0, -1}, {2, 0, 1, 0}};
  answer.normals = {{0, 0, 1}, {}, {}, {1, 0, 0}};
  answer.points = {{1, 2, 3}, {}, {}, {4, 5, 6}};
  const RayTable rays = RaysOfShape({2, 2});
  RayOptions options;
  std::vector<std::string> files = {EncodeClosest(answer, rays, options, BatchType::kNpy)};
  std::string wanted =
      "[('t', '<f8'), ('triangle', '<i8'), ('u', '<f8'), ('v', '<f8')] (2, 2)\n"
      "0.5 inf nan 2.0\n"
      "3.0 -1.0 -1.0 0.0\n"
      "0.25 0.0 0.0 0.0\n"
      "0.125 0.0 0.0 1.0\n";

  options.dtype = NumberType::kF4;
  options.fields = {kNormal, kTriangle, kPoint};
  files.push_back(EncodeClosest(answer, rays, options, BatchType::kNpy));
  wanted +=
      "[('normal', '<f4', (3,)), ('triangle', '<i4'), ('point', '<f4', (3,))] (2, 2)\n"
      "0.0 0.0 1.0 0.0 0.0 0.0 0.0 0.0 0.0 1.0 0.0 0.0\n"
      "3.0 -1.0 -1.0 0.0\n"
      "1.0 2.0 3.0 0.0 0.0 0.0 0.0 0.0 0.0 4.0 5.0 6.0\n";

  answer.groups = {5, -1, -1, 0};
  answer.uvs = {{0.5, 0.25}, {kNaN, kNaN}, {kNaN, kNaN}, {1, -1}};
  answer.shading_normals = {{0, 1, 0}, {kNaN, kNaN, kNaN}, {kNaN, kNaN, kNaN}, {0, 0, 1}};
  options.fields = {kUv, kGroup, kShadingNormal};
  files.push_back(EncodeClosest(answer, rays, options, BatchType::kNpy));
  wanted +=
      "[('uv', '<f4', (2,)), ('group', '<i4'), ('shading_normal', '<f4', (3,))] (2, 2)\n"
      "0.5 0.25 nan nan nan nan 1.0 -1.0\n"
      "5.0 -1.0 -1.0 0.0\n"
      "0.0 1.0 0.0 nan nan nan nan nan nan 0.0 0.0 1.0\n";

  options.fields = {kTriangle};
  files.push_back(EncodeClosest(answer, rays, options, BatchType::kNpy));
  wanted += "<i4 (2, 2)\n3.0 -1.0 -1.0 0.0\n";

  options.fields = {kPoint};
  files.push_back(EncodeClosest(answer, rays, options, BatchType::kNpy));
  wanted += "<f4 (2, 2, 3)\n1.0 2.0 3.0 0.0 0.0 0.0 0.0 0.0 0.0 4.0 5.0 6.0\n";

  files.push_back(EncodeAny({1}, {}, RaysOfShape({}), BatchType::kNpy));
  wanted += "|b1 ()\n1.0\n";
  files.push_back(EncodeAny({}, {}, RaysOfShape({0}), BatchType::kNpy));
  wanted += "|b1 (0,)\n\n";

  const RayTable narrow = RaysOfShape({2, 1}, NumberType::kF4);
  files.push_back(EncodeCount({3, 4000000000}, {}, narrow, BatchType::kNpy));
  wanted += "<u4 (2, 1)\n3.0 4000000000.0\n";
  files.push_back(EncodeCount({1, 2, 3, 4}, {}, rays, BatchType::kNpy));
  wanted += "<u8 (2, 2)\n1.0 2.0 3.0 4.0\n";

  const std::vector<std::vector<RayHit>> lists = {
      {{1, 0.25, 0.5, 7}, {2, 0, 0, 8}}, {}, {{3, 1, 0, 9}}, {}};
  options = {};
  options.fields = {kTriangle, kT, kSide};
  files.push_back(EncodeAll(lists, {}, rays, BatchType::kNpy, options));
  wanted +=
      "[('ray', '<i8'), ('triangle', '<i8'), ('t', '<f8'), ('side', '<i8')] (3,)\n"
      "0.0 0.0 2.0\n7.0 8.0 9.0\n1.0 2.0 3.0\n-1.0 -1.0 -1.0\n";
  options.fields = {kT};
  files.push_back(EncodeAll({{}, {{3, 1, 0, 9}}}, {}, narrow, BatchType::kNpy, options));
  wanted += "[('ray', '<i4'), ('t', '<f4')] (1,)\n1.0\n3.0\n";
  files.push_back(EncodeAll({}, {}, RaysOfShape({0}), BatchType::kNpy));
  wanted +=
      "[('ray', '<i8'), ('t', '<f8'), ('triangle', '<i8'), ('u', '<f8'), ('v', '<f8')] (0,)\n"
      "\n\n\n\n\n";

  const ImageArray image{2, 1, 3, std::vector<float>{1, 2, 3, 4, 5, 6}};
  files.push_back(ImageHeader(image).append(ImageBytes(image)));
  wanted += "<f4 (1, 2, 3)\n1.0 2.0 3.0 4.0 5.0 6.0\n";

  EXPECT_EQ(Dump(files), wanted);
}

}  // namespace
}  // namespace kdray::api
