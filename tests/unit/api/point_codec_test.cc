// SPDX-License-Identifier: Apache-2.0
#include "api/point_codec.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <string>
#include <vector>

#include "tests/unit/api/answers.h"
#include "tests/unit/api/npy_bytes.h"

namespace kdray::api {
namespace {

using testing::HasSubstr;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

std::string Header(const std::string& descr, bool fortran, const std::string& shape) {
  return "{'descr': '" + descr + "', 'fortran_order': " + (fortran ? "True" : "False") +
         ", 'shape': " + shape + ", }";
}

std::string DataOf(const std::string& npy) {
  const auto length =
      static_cast<unsigned char>(npy[8]) + 256U * static_cast<unsigned char>(npy[9]);
  return npy.substr(10 + length);
}
std::string HeaderOf(const std::string& npy) {
  const auto length =
      static_cast<unsigned char>(npy[8]) + 256U * static_cast<unsigned char>(npy[9]);
  return npy.substr(10, length);
}

TEST(PointCodec, ReadsJsonRows) {
  const auto points =
      DecodePoints(R"({"points": [[1, 2.5, -3e2], [0, -0, 1e39]]})", BatchType::kJson, Limits{});
  ASSERT_TRUE(points) << points.problem().detail;
  EXPECT_EQ(points->shape, (std::vector<std::size_t>{2}));
  EXPECT_EQ(points->rows, (std::vector<Vec3>{{1, 2.5, -300}, {0, 0, 1e39}}));
  EXPECT_EQ(points->number_type, NumberType::kF8);
  const auto none = DecodePoints(R"({"points": []})", BatchType::kJson, Limits{});
  ASSERT_TRUE(none);
  EXPECT_EQ(none->size(), 0u);
}

TEST(PointCodec, NamesThePlaceOfAnErrorInJson) {
  Limits limits;
  limits.max_rays = 2;
  const struct {
    const char* body;
    ErrorCode code;
    const char* parameter;
    const char* detail;
  } kCases[] = {
      {R"({"points": [[1, 2, 3], [4, 5]]})", ErrorCode::kInvalidJson, "/points/1", "2 numbers"},
      {R"({"points": [[1, 2, 3, 4]]})", ErrorCode::kInvalidJson, "/points/0", "3 numbers (x y z)"},
      {R"({"points": [[1, null, 3]]})", ErrorCode::kInvalidJson, "/points/0/1", "null"},
      {R"({"points": [[1, 2, "3"]]})", ErrorCode::kInvalidJson, "/points/0/2", "string"},
      {R"({"points": [1, 2, 3]})", ErrorCode::kInvalidJson, "/points/0", "number"},
      {R"({"points": [[1, 2, 1e999]]})", ErrorCode::kInvalidJson, "/points/0/2", "1e999"},
      {R"({"points": [[[1, 2, 3]]]})", ErrorCode::kInvalidJson, "/points/0/0", "array"},
      {R"({"rays": []})", ErrorCode::kInvalidParameter, "/rays", "'points'"},
      {R"({"points": [], "points": []})", ErrorCode::kInvalidJson, "/points", "repeated"},
      {R"({})", ErrorCode::kInvalidJson, "/points", "missing"},
      {R"([[1, 2, 3]])", ErrorCode::kInvalidJson, "", "{\"points\": [[…],…]}"},
      {R"({"points": [[1,2,3],[1,2,3],[1,2,3]]})", ErrorCode::kTooManyRays, "/points", "2 rows"},
  };
  for (const auto& test : kCases) {
    const auto points = DecodePoints(test.body, BatchType::kJson, limits);
    ASSERT_FALSE(points) << test.body;
    EXPECT_EQ(points.problem().code, test.code) << test.body;
    EXPECT_EQ(points.problem().parameter.value_or("-"), test.parameter) << test.body;
    EXPECT_THAT(points.problem().detail, HasSubstr(test.detail)) << test.body;
  }
}

TEST(PointCodec, ReadsArraysOfBothTypesAndOrders) {
  const auto counted = Counted<float>(12);
  const auto c_order = DecodePoints(NpyFile(Header("<f4", false, "(2, 2, 3)"), Bytes(counted)),
                                    BatchType::kNpy, Limits{});
  ASSERT_TRUE(c_order) << c_order.problem().detail;
  EXPECT_EQ(c_order->shape, (std::vector<std::size_t>{2, 2}));
  EXPECT_EQ(c_order->rows, (std::vector<Vec3>{{0, 1, 2}, {3, 4, 5}, {6, 7, 8}, {9, 10, 11}}));
  EXPECT_EQ(c_order->number_type, NumberType::kF4);
  // Element [i][j][k] of a Fortran array lies at i + 2 j + 4 k.
  const auto fortran =
      DecodePoints(NpyFile(Header("<f8", true, "(2, 2, 3)"), Bytes(Counted<double>(12))),
                   BatchType::kNpy, Limits{});
  ASSERT_TRUE(fortran);
  EXPECT_EQ(fortran->rows, (std::vector<Vec3>{{0, 4, 8}, {2, 6, 10}, {1, 5, 9}, {3, 7, 11}}));
  const auto one = DecodePoints(NpyFile(Header("<f8", false, "(3,)"), Bytes(Counted<double>(3))),
                                BatchType::kNpy, Limits{});
  ASSERT_TRUE(one);
  EXPECT_TRUE(one->shape.empty());
  EXPECT_EQ(one->rows, (std::vector<Vec3>{{0, 1, 2}}));
  const auto none =
      DecodePoints(NpyFile(Header("<f8", false, "(4, 0, 3)"), ""), BatchType::kNpy, Limits{});
  ASSERT_TRUE(none);
  EXPECT_EQ(none->shape, (std::vector<std::size_t>{4, 0}));
  EXPECT_EQ(none->size(), 0u);
}

TEST(PointCodec, RefusesOtherArrays) {
  Limits limits;
  limits.max_rays = 3;
  const auto code = [&](const std::string& shape, std::size_t numbers) {
    const auto points =
        DecodePoints(NpyFile(Header("<f8", false, shape), Bytes(Counted<double>(numbers))),
                     BatchType::kNpy, limits);
    return points ? "taken" : std::string(Name(points.problem().code));
  };
  EXPECT_EQ(code("(2, 6)", 12), "invalid_array");
  EXPECT_EQ(code("(6,)", 6), "invalid_array");
  EXPECT_EQ(code("()", 1), "invalid_array");
  EXPECT_EQ(code("(2, 3)", 5), "invalid_array");
  EXPECT_EQ(code("(4, 3)", 12), "too_many_rays");
  EXPECT_EQ(code("(3, 3)", 9), "taken");
}

TEST(PointCodec, StopsWhenItIsTold) {
  const std::string npy = NpyFile(Header("<f4", false, "(4, 3)"), Bytes(Counted<float>(12)));
  EXPECT_FALSE(DecodePoints(npy, BatchType::kNpy, Limits{},
                            {.should_stop = [] { return true; }, .run = {}, .charge = {}}));
}

PointTable Rows(std::size_t count, NumberType type = NumberType::kF8) {
  return {{count}, std::vector<Vec3>(count), type};
}

const std::vector<NearestPoint> kFound = {{1.5, {1, -0.0, 3}, {0, 0, 1}, 0.25, 0.5, 7},
                                          {kNan, {kNan, kNan, kNan}, {kNan, kNan, kNan}, 0, 0, -1},
                                          {1e300, {-1e300, 0, 0}, {1, 0, 0}, 1, 0, 0}};

TEST(PointCodec, WritesClosestPointsAsJson) {
  const PointTable points = Rows(3);
  const PointOptions options;
  PointWriter writer(points, options, BatchType::kJson);
  EXPECT_FALSE(writer.Put(std::span(kFound).first(1)));
  EXPECT_FALSE(writer.Put(std::span(kFound).subspan(1)));
  EXPECT_EQ(Join(std::move(writer).Finish({1})),
            R"({"results":[{"distance":1.5,"point":[1,0,3],"triangle":7,"u":0.25,"v":0.5},null,)"
            R"({"distance":1e+300,"point":[-1e+300,0,0],"triangle":0,"u":1,"v":0}],)"
            R"("invalid":[1],"truncated":[]})");
}

TEST(PointCodec, WritesTheFieldsInTheirOrderAndTheNumbersInTheirType) {
  const PointTable points = Rows(3, NumberType::kF4);
  PointOptions options;
  options.fields = {PointField::kNormal, PointField::kDistance};
  {
    PointWriter writer(points, options, BatchType::kJson);
    EXPECT_FALSE(writer.Put(std::span(kFound).subspan(2)));
    EXPECT_EQ(Join(std::move(writer).Finish({})),
              R"({"results":[{"normal":[1,0,0],"distance":3.4028235e+38}],)"
              R"("invalid":[],"truncated":[]})");
  }
  PointWriter writer(points, options, BatchType::kNpy);
  EXPECT_FALSE(writer.Put(std::span(kFound)));
  const std::string npy = Join(std::move(writer).Finish({1}));
  EXPECT_THAT(HeaderOf(npy), HasSubstr("[('normal', '<f4', (3,)), ('distance', '<f4')]"));
  EXPECT_THAT(HeaderOf(npy), HasSubstr("'shape': (3,)"));
  float numbers[12];
  ASSERT_EQ(DataOf(npy).size(), sizeof(numbers));
  std::memcpy(numbers, DataOf(npy).data(), sizeof(numbers));
  EXPECT_EQ(numbers[3], 1.5F);
  EXPECT_TRUE(std::isnan(numbers[4]) && std::isnan(numbers[7]));
  EXPECT_EQ(numbers[11], std::numeric_limits<float>::max());
}

TEST(PointCodec, WritesOneFieldAsAPlainArrayOfTheLeadingShape) {
  const PointTable points = {{1, 3}, std::vector<Vec3>(3), NumberType::kF8};
  PointOptions options;
  options.fields = {PointField::kPoint};
  {
    PointWriter writer(points, options, BatchType::kNpy);
    EXPECT_FALSE(writer.Put(std::span(kFound)));
    const std::string npy = Join(std::move(writer).Finish({}));
    EXPECT_THAT(HeaderOf(npy), HasSubstr("'<f8'"));
    EXPECT_THAT(HeaderOf(npy), HasSubstr("'shape': (1, 3, 3)"));
    EXPECT_EQ(DataOf(npy).size(), 72u);
    EXPECT_EQ(DataOf(npy).find(Bytes<double>({-0.0})), std::string::npos);
  }
  options.fields = {PointField::kTriangle};
  options.dtype = NumberType::kF4;
  PointWriter writer(points, options, BatchType::kNpy);
  EXPECT_FALSE(writer.Put(std::span(kFound)));
  const std::string npy = Join(std::move(writer).Finish({}));
  EXPECT_THAT(HeaderOf(npy), HasSubstr("'<i4'"));
  EXPECT_EQ(DataOf(npy), Bytes<std::int32_t>({7, -1, 0}));
}

TEST(PointCodec, WritesSignedDistancesAndSides) {
  const PointTable points = Rows(4);
  const PointOptions options;
  const std::vector<double> distances = {-2.5, -0.0, kNan, kInfinity};
  const std::vector<std::int8_t> sides = {1, 0, -1, 0};
  const auto write = [&](BatchType type, const auto& rows) {
    PointWriter writer(points, options, type);
    EXPECT_FALSE(writer.Put(std::span(rows)));
    return Join(std::move(writer).Finish({2}));
  };
  EXPECT_EQ(write(BatchType::kJson, distances),
            R"({"results":[-2.5,0,null,null],"invalid":[2],"truncated":[]})");
  EXPECT_EQ(write(BatchType::kJson, sides),
            R"({"results":[true,false,null,false],"invalid":[2],"truncated":[]})");
  const std::string npy = write(BatchType::kNpy, distances);
  EXPECT_THAT(HeaderOf(npy), HasSubstr("'<f8'"));
  EXPECT_EQ(DataOf(npy).substr(0, 16), Bytes<double>({-2.5, 0.0}));
  const std::string bytes = write(BatchType::kNpy, sides);
  EXPECT_THAT(HeaderOf(bytes), HasSubstr("'|i1'"));
  EXPECT_EQ(DataOf(bytes), std::string("\x01\x00\xff\x00", 4));
}

TEST(PointCodec, WritesAnEmptyAnswer) {
  const PointTable points = Rows(0);
  const PointOptions options;
  for (const BatchType type : {BatchType::kJson, BatchType::kNpy}) {
    PointWriter writer(points, options, type);
    EXPECT_FALSE(writer.Put(std::span<const NearestPoint>()));
    const std::string answer = Join(std::move(writer).Finish({}));
    if (type == BatchType::kJson) {
      EXPECT_EQ(answer, R"({"results":[],"invalid":[],"truncated":[]})");
    } else {
      EXPECT_THAT(HeaderOf(answer), HasSubstr("'shape': (0,)"));
      EXPECT_EQ(DataOf(answer), "");
    }
  }
}

}  // namespace
}  // namespace kdray::api
