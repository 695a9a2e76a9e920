// SPDX-License-Identifier: Apache-2.0
#include "api/batch_codec.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <ctime>
#include <limits>
#include <nlohmann/json.hpp>
#include <random>
#include <string>

#include "api/npy.h"
#include "tests/support/ray_rows.h"
#include "tests/support/seed.h"
#include "tests/unit/api/answers.h"
#include "tests/unit/api/npy_bytes.h"

namespace kdray::api {
namespace {

using nlohmann::json;
using testing::HasSubstr;
using testing::StartsWith;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
const Limits kLimits;

/// Rows: a hit, a miss, an invalid row.
ClosestAnswer Answer() {
  ClosestAnswer answer;
  answer.hits = {{0.1, 0.25, 1.0 / 3, 7}, {kInfinity, 0, 0, -1}, {kNaN, 0, 0, -1}};
  answer.normals = {{0, 0.6, -0.8}, {kNaN, kNaN, kNaN}, {kNaN, kNaN, kNaN}};
  answer.points = {{0.1, -2, 1e300}, {kNaN, kNaN, kNaN}, {kNaN, kNaN, kNaN}};
  answer.invalid = {2};
  return answer;
}

/// The table of a JSON batch.
RayTable JsonRays(std::size_t rows) {
  return RayTable(std::make_unique<double[]>(rows * kRayNumbers), rows);
}

std::string Encode(const ClosestAnswer& answer, std::vector<RayField> fields, BatchType type,
                   std::optional<NumberType> dtype = std::nullopt,
                   std::vector<std::size_t> shape = {3}) {
  const RayTable rays = RaysOfShape(std::move(shape));
  RayOptions options;
  options.fields = std::move(fields);
  options.dtype = dtype;
  return EncodeClosest(answer, rays, options, type);
}

using enum RayField;

TEST(ClosestAsJson, HasTheFieldsInTheOrderAsked) {
  EXPECT_EQ(Encode(Answer(), {kT, kTriangle, kU, kV}, BatchType::kJson),
            R"({"results":[{"t":0.1,"triangle":7,"u":0.25,"v":0.3333333333333333},null,null],)"
            R"("invalid":[2],"truncated":[]})");
  EXPECT_EQ(Encode(Answer(), {kTriangle}, BatchType::kJson),
            R"({"results":[{"triangle":7},null,null],"invalid":[2],"truncated":[]})");
  EXPECT_THAT(Encode(Answer(), {kPoint, kNormal}, BatchType::kJson, NumberType::kF8),
              StartsWith(R"({"results":[{"point":[0.1,-2,1e+300],)"
                         R"("normal":[0,0.6,-0.8]},null)"));
}

TEST(ClosestAsJson, HasNullForWhatTheFileDoesNotHave) {
  ClosestAnswer answer;
  answer.hits = {{1, 0, 0, 7}, {2, 0, 0, 8}, {kInfinity, 0, 0, -1}};
  answer.groups = {3, -1, -1};
  answer.uvs = {{0.5, -2}, {kNaN, kNaN}, {kNaN, kNaN}};
  answer.shading_normals = {{0, 0, 1}, {kNaN, kNaN, kNaN}, {kNaN, kNaN, kNaN}};
  EXPECT_THAT(Encode(answer, {kGroup, kUv, kShadingNormal}, BatchType::kJson),
              StartsWith(R"({"results":[{"group":3,"uv":[0.5,-2],"shading_normal":[0,0,1]},)"
                         R"({"group":-1,"uv":null,"shading_normal":null},null])"));
}

TEST(ClosestAsJson, WritesFloatsInTheirShortestText) {
  EXPECT_THAT(Encode(Answer(), {kT, kV, kNormal}, BatchType::kJson, NumberType::kF4),
              StartsWith(R"({"results":[{"t":0.1,"v":0.33333334,"normal":[0,0.6,-0.8]},)"));
}

TEST(ClosestAsJson, OfNoRowsIsStillAnAnswer) {
  EXPECT_EQ(Encode({}, {kT}, BatchType::kJson, std::nullopt, {0}),
            R"({"results":[],"invalid":[],"truncated":[]})");
}

TEST(ClosestAnswers, KeepAHitFiniteWhenFloatCannotHoldIt) {
  ClosestAnswer answer;
  answer.hits = {{1e300, 0, 0, 1}};
  EXPECT_THAT(Encode(answer, {kT}, BatchType::kJson, NumberType::kF4),
              HasSubstr("{\"t\":3.4028235e+38}"));
  const std::string npy = Encode(answer, {kT}, BatchType::kNpy, NumberType::kF4, {1});
  const auto array = ReadNpy(npy);
  ASSERT_TRUE(array);
  EXPECT_EQ(array->data, Bytes(std::vector<float>{std::numeric_limits<float>::max()}));
}

TEST(ClosestAnswers, HaveFiniteHitsAndNoNegativeZeroInEitherForm) {
  ClosestAnswer answer;
  answer.hits = {{kInfinity, -0.0, -0.0, 1}, {-0.0, 0, -1e-300, 1}, {kInfinity, 0, 0, -1}};
  answer.normals = {{-0.0, 1, -0.0}, {-0.0, -1, 0}, {kNaN, kNaN, kNaN}};
  answer.points = {{-0.0, -1e-300, 1e300}, {0, 0, 0}, {kNaN, kNaN, kNaN}};
  const std::vector<RayField> fields = {kT, kU, kV, kNormal, kPoint};
  for (const NumberType type : {NumberType::kF4, NumberType::kF8}) {
    const bool wide = type == NumberType::kF8;
    const std::string text = Encode(answer, fields, BatchType::kJson, type);
    const json parsed = json::parse(text);
    EXPECT_THAT(text, Not(HasSubstr("-0,"))) << text;
    EXPECT_THAT(text, Not(HasSubstr("-0.0"))) << text;
    EXPECT_EQ(parsed["results"][0]["t"].get<double>(),
              wide ? 1.7976931348623157e308 : 3.4028235e38);
    EXPECT_EQ(parsed["results"][1]["t"].get<double>(), 0.0);
    EXPECT_TRUE(parsed["results"][2].is_null());

    const std::string npy = Encode(answer, fields, BatchType::kNpy, type);
    const std::size_t size = wide ? 8 : 4;
    ASSERT_GT(npy.size(), 3 * 9 * size);
    const std::string_view bytes = std::string_view(npy).substr(npy.size() - 3 * 9 * size);
    const auto number = [&](std::size_t i) {
      double d = 0;
      float f = 0;
      std::memcpy(wide ? static_cast<void*>(&d) : &f, bytes.data() + i * size, size);
      return wide ? d : static_cast<double>(f);
    };
    for (std::size_t i = 0; i < 3 * 9; ++i) {
      EXPECT_FALSE(number(i) == 0 && std::signbit(number(i))) << i;
    }
    EXPECT_EQ(number(0), wide ? std::numeric_limits<double>::max()
                              : static_cast<double>(std::numeric_limits<float>::max()));
    EXPECT_EQ(number(2 * 9), kInfinity) << "a miss stays infinite";
  }
}

TEST(ClosestAsNpy, OfOneFieldIsAPlainArray) {
  const std::string f8 = Encode(Answer(), {kT}, BatchType::kNpy);
  auto array = ReadNpy(f8);
  ASSERT_TRUE(array);
  EXPECT_EQ(array->type, NumberType::kF8);
  EXPECT_THAT(array->shape, testing::ElementsAre(3));
  double t[3];
  std::memcpy(t, array->data.data(), sizeof(t));
  EXPECT_EQ(t[0], 0.1);
  EXPECT_EQ(t[1], kInfinity);
  EXPECT_TRUE(std::isnan(t[2]));

  const std::string normals = Encode(Answer(), {kNormal}, BatchType::kNpy, NumberType::kF4);
  array = ReadNpy(normals);
  ASSERT_TRUE(array);
  EXPECT_EQ(array->type, NumberType::kF4);
  EXPECT_THAT(array->shape, testing::ElementsAre(3, 3));
  EXPECT_THAT(array->data, StartsWith(Bytes(std::vector<float>{0, 0.6f, -0.8f})));

  EXPECT_THAT(Encode(Answer(), {kTriangle}, BatchType::kNpy),
              StartsWith(std::string("\x93NUMPY\x01\x00\x76\x00", 10) + "{'descr': '<i8'"));
  const std::string triangles = Encode(Answer(), {kTriangle}, BatchType::kNpy, NumberType::kF4);
  EXPECT_THAT(triangles, HasSubstr("'<i4'"));
  EXPECT_THAT(triangles, testing::EndsWith(Bytes(std::vector<std::int32_t>{7, -1, -1})));
}

TEST(ClosestAsNpy, OfSeveralFieldsIsAPackedStructuredArray) {
  const std::string npy =
      Encode(Answer(), {kTriangle, kPoint, kU}, BatchType::kNpy, NumberType::kF8);
  EXPECT_THAT(npy, HasSubstr("[('triangle', '<i8'), ('point', '<f8', (3,)), ('u', '<f8')], "
                             "'fortran_order': False, 'shape': (3,), }"));
  const std::size_t header = npy.find('\n') + 1;
  EXPECT_EQ(header % 64, 0u);
  EXPECT_EQ(npy.size() - header, 3u * (8 + 24 + 8));
  EXPECT_EQ(npy.substr(header, 40),
            Bytes(std::vector<std::int64_t>{7}) + Bytes(std::vector<double>{0.1, -2, 1e300, 0.25}));
}

TEST(ClosestAsNpy, KeepsTheLeadingShape) {
  ClosestAnswer answer;
  answer.hits.resize(6, {1, 0, 0, 0});
  EXPECT_THAT(Encode(answer, {kT}, BatchType::kNpy, std::nullopt, {2, 3}),
              HasSubstr("'shape': (2, 3), }"));
  answer.hits.resize(1);
  EXPECT_THAT(Encode(answer, {kT}, BatchType::kNpy, std::nullopt, {}), HasSubstr("'shape': (), }"));
  answer.hits.clear();
  EXPECT_THAT(Encode(answer, {kT, kU}, BatchType::kNpy, std::nullopt, {4, 0}),
              HasSubstr("'shape': (4, 0), }"));
}

TEST(ClosestAnswers, TakeTheTypeOfTheRequestUnlessDtypeNamesOne) {
  ClosestAnswer answer;
  answer.hits = {{1, 0, 0, 0}};
  const std::string zeros(6 * sizeof(float), '\0');
  const RayTable narrow = RaysOfShape({1}, NumberType::kF4);
  const RayTable widened =
      *RayTable::FromNpy({NumberType::kF4, false, {1, 6}, zeros}, 1e-3, kInfinity, 1);
  EXPECT_EQ(widened.row_type(), NumberType::kF8);
  RayOptions options;
  options.fields = {kT};
  EXPECT_THAT(EncodeClosest(answer, narrow, options, BatchType::kNpy), HasSubstr("'<f4'"));
  EXPECT_THAT(EncodeClosest(answer, widened, options, BatchType::kNpy), HasSubstr("'<f4'"));
  EXPECT_THAT(EncodeClosest(answer, JsonRays(1), options, BatchType::kNpy), HasSubstr("'<f8'"));
  options.dtype = NumberType::kF8;
  EXPECT_THAT(EncodeClosest(answer, narrow, options, BatchType::kNpy), HasSubstr("'<f8'"));
  options.dtype = NumberType::kF4;
  EXPECT_THAT(EncodeClosest(answer, JsonRays(1), options, BatchType::kNpy), HasSubstr("'<f4'"));
}

TEST(AnyAnswers, AreBooleans) {
  EXPECT_EQ(EncodeAny({1, 0, 1}, {1}, JsonRays(3), BatchType::kJson),
            R"({"results":[true,false,true],"invalid":[1],"truncated":[]})");
  const std::string npy = EncodeAny({1, 0, 1}, {1}, JsonRays(3), BatchType::kNpy);
  EXPECT_THAT(npy, HasSubstr("{'descr': '|b1', 'fortran_order': False, 'shape': (3,), }"));
  EXPECT_THAT(npy, testing::EndsWith(std::string("\n\1\0\1", 4)));
}

TEST(Counts, AreNumbersOfTheRequestedSize) {
  EXPECT_EQ(EncodeCount({2, 0, 4294967295}, {1}, JsonRays(3), BatchType::kJson),
            R"({"results":[2,0,4294967295],"invalid":[1],"truncated":[]})");
  const std::string wide = EncodeCount({2, 0}, {}, JsonRays(2), BatchType::kNpy);
  EXPECT_THAT(wide, HasSubstr("{'descr': '<u8', 'fortran_order': False, 'shape': (2,), }"));
  EXPECT_THAT(wide, testing::EndsWith(Bytes(std::vector<std::uint64_t>{2, 0})));
  RayOptions options;
  options.dtype = NumberType::kF4;
  EXPECT_THAT(EncodeCount({7}, {}, JsonRays(1), BatchType::kNpy, options),
              testing::EndsWith(Bytes(std::vector<std::uint32_t>{7})));
}

TEST(AllHits, AreAListPerRowInJsonAndOneListInNpy) {
  const std::vector<std::vector<RayHit>> hits = {
      {{1, 0.5, 0.25, 3}, {2, 0, 0, 4}}, {}, {{-0.0, 0, 1, 5}}, {}};
  RayOptions options;
  options.fields = {kT, kTriangle, kSide};
  BatchReport report;
  report.invalid = {3};
  report.truncated = {0, 2};
  EXPECT_EQ(EncodeAll(hits, report, JsonRays(4), BatchType::kJson, options),
            R"({"results":[[{"t":1,"triangle":3,"side":-1},{"t":2,"triangle":4,"side":-1}],[],)"
            R"([{"t":0,"triangle":5,"side":-1}],[]],"invalid":[3],"truncated":[0,2]})");
  options.dtype = NumberType::kF4;
  const std::string npy = EncodeAll(hits, report, RaysOfShape({2, 2}), BatchType::kNpy, options);
  EXPECT_THAT(npy, HasSubstr("[('ray', '<i4'), ('t', '<f4'), ('triangle', '<i4'), "
                             "('side', '<i4')], 'fortran_order': False, 'shape': (3,), }"));
  const auto row = [](std::int32_t ray, float t, std::int32_t triangle) {
    return Bytes(std::vector<std::int32_t>{ray}) + Bytes(std::vector<float>{t}) +
           Bytes(std::vector<std::int32_t>{triangle, -1});
  };
  EXPECT_THAT(npy, testing::EndsWith(row(0, 1, 3) + row(0, 2, 4) + row(2, 0, 5)));
}

TEST(ClosestAnswers, AreTheSameBytesHoweverTheyArrive) {
  ClosestAnswer answer;
  for (int i = 0; i < 10'000; ++i) {
    answer.hits.push_back(i % 5 == 0 ? RayHit{kInfinity, 0, 0, -1} : RayHit{i * 0.1, 0.25, 0.5, i});
  }
  for (const BatchType type : {BatchType::kJson, BatchType::kNpy}) {
    const RayTable rays = RaysOfShape({100, 100});
    const std::string whole = EncodeClosest(answer, rays, {}, type);
    EXPECT_EQ(EncodeClosest(answer, rays, {}, type, 777), whole);
    EXPECT_EQ(EncodeClosest(answer, rays, {}, type, 1), whole);
  }
}

/// Counts its blocks.
class CountingSource final : public BlockSource {
 public:
  explicit CountingSource(std::size_t block_bytes) : block_bytes_(block_bytes) {}
  std::size_t block_bytes() const override { return block_bytes_; }
  char* Take() override {
    ++taken;
    return new char[block_bytes_];
  }
  void GiveBack(char* block) noexcept override {
    --taken;
    delete[] block;
  }
  int taken = 0;

 private:
  const std::size_t block_bytes_;
};

TEST(Answers, OfLargeArraysLieInBlocksOfTheSourceAndAreTheSameBytes) {
  ClosestAnswer answer;
  for (int i = 0; i < 10'000; ++i) answer.hits.push_back({i * 0.1, 0.25, 0.5, i});
  const RayTable rays = RaysOfShape({10'000}, NumberType::kF4);
  const std::string whole = EncodeClosest(answer, rays, {}, BatchType::kNpy);  // 16 bytes a row
  // Rows of an answer at a time, bytes of the source's blocks, and how many blocks are taken.
  struct Case {
    std::size_t rows, block_bytes;
    int blocks;
  };
  for (const auto& [rows, block_bytes, blocks] :
       {Case{1000, 64'000, 3}, Case{1000, 40'000, 5}, Case{1000, 16'000, 10}, Case{1000, 15'999, 0},
        Case{1000, 320'002, 0}, Case{1000, 320'000, 1}, Case{777, 100'000, 2},
        Case{10'000, 160'000, 1}}) {
    CountingSource source(block_bytes);
    std::uint64_t charged = 0;
    const auto charge = [&charged](std::uint64_t bytes) -> Check {
      charged += bytes;
      return std::nullopt;
    };
    {
      const auto writer = WriterOfClosest(rays, {}, BatchType::kNpy, charge, &source);
      for (std::size_t first = 0; first < 10'000; first += rows) {
        const std::size_t count = std::min(rows, 10'000 - first);
        ASSERT_FALSE(writer->Begin(count));
        writer->Put({.first_row = first,
                     .hits = {.hits = Part(answer.hits, first, count),
                              .normals = {},
                              .points = {},
                              .sides = {}}});
      }
      Outcome<std::vector<ByteBlock>> pieces = std::move(*writer).Finish({});
      ASSERT_TRUE(pieces);
      EXPECT_EQ(source.taken, blocks) << rows << " " << block_bytes;
      std::uint64_t held = 0;
      for (std::size_t i = 1; i < pieces->size(); ++i) held += (*pieces)[i].capacity();
      EXPECT_EQ(charged, held);
      EXPECT_EQ(Join(std::move(pieces)), whole);
    }
    EXPECT_EQ(source.taken, 0);
  }
}

TEST(Answers, EndWithTheProblemOfTheirMemory) {
  for (const BatchType type : {BatchType::kJson, BatchType::kNpy}) {
    std::uint64_t left = 100'000;
    const auto charge = [&left](std::uint64_t bytes) -> Check {
      if (bytes > left) return Problem{ErrorCode::kMemoryFull, "there is no more"};
      left -= bytes;
      return std::nullopt;
    };
    const RayTable rays = RaysOfShape({10'000});
    const auto writer = WriterOfClosest(rays, {}, type, charge);
    const std::vector<RayHit> hits(1000, RayHit{0.1, 0.2, 0.3, 4});
    Check problem;
    for (std::size_t first = 0; first < 10'000 && !problem; first += hits.size()) {
      problem = writer->Begin(hits.size());
      if (problem) break;
      writer->Put(
          {.first_row = first, .hits = {.hits = hits, .normals = {}, .points = {}, .sides = {}}});
    }
    ASSERT_TRUE(problem);
    EXPECT_EQ(problem->code, ErrorCode::kMemoryFull);
    EXPECT_FALSE(std::move(*writer).Finish({}));
  }
}

std::string ImageFile(const ImageArray& image) {
  return ImageHeader(image).append(ImageBytes(image));
}

TEST(Images, AreArraysInCOrder) {
  const ImageArray depth{2, 1, 1, std::vector<float>{1.5f, 2.5f}};
  const std::string depth_npy = ImageFile(depth);
  const auto array = ReadNpy(depth_npy);
  ASSERT_TRUE(array);
  EXPECT_THAT(array->shape, testing::ElementsAre(1, 2));
  EXPECT_EQ(array->data, Bytes(std::vector<float>{1.5f, 2.5f}));
  const ImageArray normal{1, 2, 3, std::vector<float>(6)};
  EXPECT_THAT(ImageFile(normal), HasSubstr("'shape': (2, 1, 3), }"));
  const ImageArray triangle{2, 1, 1, std::vector<std::int32_t>{-1, 5}};
  EXPECT_THAT(ImageFile(triangle), HasSubstr("'<i4'"));
  EXPECT_THAT(ImageFile(triangle), testing::EndsWith(Bytes(std::vector<std::int32_t>{-1, 5})));
}

TEST(Batches, AreReadWithTheOptionsThatFillThem) {
  RayOptions options;
  options.t_min = 0.5;
  options.t_max = 2;
  const auto from_json = DecodeRays("{\"rays\":[[0,1,2,3,4,5],[0,1,2,3,4,5,6,7]]}",
                                    BatchType::kJson, options, kLimits);
  ASSERT_TRUE(from_json);
  EXPECT_THAT(from_json->shape(), testing::ElementsAre(2));
  EXPECT_EQ(from_json->number_type(), NumberType::kF8);
  const auto rows = test::RowsOf(*from_json);
  EXPECT_EQ(rows[0].t_min, 0.5);
  EXPECT_EQ(rows[0].t_max, 2);
  EXPECT_EQ(rows[1].t_min, 6);
  EXPECT_EQ(rows[1].t_max, 7);

  const std::string npy =
      NpyFile("{'descr': '<f4', 'fortran_order': False, 'shape': (6,)}", Bytes(Counted<float>(6)));
  const auto from_npy = DecodeRays(npy, BatchType::kNpy, options, kLimits);
  ASSERT_TRUE(from_npy);
  EXPECT_EQ(test::RowsOf(*from_npy)[0].t_max, 2);
  EXPECT_EQ(DecodeRays(npy, BatchType::kJson, options, kLimits).problem().code,
            ErrorCode::kInvalidJson);
  EXPECT_EQ(DecodeRays("{}", BatchType::kNpy, options, kLimits).problem().code,
            ErrorCode::kInvalidArray);
}

TEST(Batches, AreBoundedInBytesAndRows) {
  Limits limits;
  limits.max_rays = 2;
  const std::string rows = "{\"rays\":[[0,1,2,3,4,5],[0,1,2,3,4,5]";
  EXPECT_TRUE(DecodeRays(rows + "]}", BatchType::kJson, {}, limits));
  EXPECT_EQ(DecodeRays(rows + ",[0,1,2,3,4,5]]}", BatchType::kJson, {}, limits).problem().code,
            ErrorCode::kTooManyRays);
  std::string padded = rows + "]}";
  padded.resize(limits.MaxBatchBytes(), ' ');
  EXPECT_TRUE(DecodeRays(padded, BatchType::kJson, {}, limits));
  const auto large = DecodeRays(padded + ' ', BatchType::kJson, {}, limits);
  ASSERT_FALSE(large);
  EXPECT_EQ(large.problem().code, ErrorCode::kBodyTooLarge);
  EXPECT_EQ(large.problem().limit, static_cast<double>(limits.MaxBatchBytes()));
}

TEST(ClosestAnswers, SayTheSameInBothForms) {
  auto random = test::RandomEngine(1003);
  std::uniform_real_distribution<double> unit(0, 1);
  ClosestAnswer answer;
  for (int i = 0; i < 5000; ++i) {
    if (random() % 4 == 0) {
      answer.hits.push_back({kInfinity, 0, 0, -1});
    } else {
      const int exponent = static_cast<int>(random() % 80) - 40;
      answer.hits.push_back({std::ldexp(unit(random), exponent), unit(random), unit(random),
                             static_cast<std::int32_t>(random() % 2000000000)});
    }
  }
  for (const NumberType type : {NumberType::kF4, NumberType::kF8}) {
    const json results = json::parse(Encode(answer, {kU, kTriangle, kT}, BatchType::kJson, type,
                                            {answer.hits.size()}))["results"];
    const std::string npy =
        Encode(answer, {kU, kTriangle, kT}, BatchType::kNpy, type, {answer.hits.size()});
    const char* at = npy.data() + npy.find('\n') + 1;
    ASSERT_EQ(results.size(), answer.hits.size());
    const auto compare = [&](auto number, auto integer) {
      for (const json& result : results) {
        decltype(number) u, t;
        std::memcpy(&u, at, sizeof(u));
        std::memcpy(&integer, at + sizeof(u), sizeof(integer));
        std::memcpy(&t, at + 2 * sizeof(u), sizeof(t));
        at += 3 * sizeof(u);
        ASSERT_EQ(result.is_null(), integer == -1);
        if (result.is_null()) continue;
        // The text of a float, read as double, may differ from the float: what counts is the float
        // nearest to it.
        ASSERT_EQ(static_cast<decltype(number)>(result["u"].get<double>()), u);
        ASSERT_EQ(static_cast<decltype(number)>(result["t"].get<double>()), t);
        ASSERT_EQ(result["triangle"].get<std::int64_t>(), integer);
      }
    };
    if (type == NumberType::kF4) {
      compare(float{}, std::int32_t{});
    } else {
      compare(double{}, std::int64_t{});
    }
    EXPECT_EQ(at, npy.data() + npy.size());
  }
}

// A guard against quadratic mistakes, far from what a quiet machine needs (npy 2 ms, JSON 150 ms).
TEST(Batches, Of200000RaysAreReadAndAnsweredInNoTime) {
  constexpr std::size_t kRows = 200000;
  auto random = test::RandomEngine(1004);
  std::uniform_real_distribution<double> unit(-1, 1);
  std::vector<double> numbers(kRows * 6);
  for (double& number : numbers) number = unit(random);
  const std::vector<std::size_t> shape = {kRows, 6};
  const std::string npy = NpyHeader("'<f8'", shape) + Bytes(numbers);
  std::string text = "{\"rays\":[";
  for (std::size_t row = 0; row < kRows; ++row) {
    text += row == 0 ? "[" : ",[";
    for (std::size_t c = 0; c < 6; ++c) {
      if (c != 0) text += ',';
      text += json(numbers[6 * row + c]).dump();
    }
    text += ']';
  }
  text += "]}";

  // Processor time, for the machine may be busy.
  const auto timed = [](const char* what, double limit_ms, const auto& work) {
    const std::clock_t start = std::clock();
    work();
    const double ms = 1e3 * static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
    testing::Test::RecordProperty(what, std::to_string(ms) + " ms");
    EXPECT_LT(ms, limit_ms) << what;
  };
  RayTable from_npy, from_json;
  timed("npy_decode", 200, [&] { from_npy = *DecodeRays(npy, BatchType::kNpy, {}, kLimits); });
  timed("json_decode", 4000, [&] { from_json = *DecodeRays(text, BatchType::kJson, {}, kLimits); });
  const auto a = test::RowsOf(from_npy), b = test::RowsOf(from_json);
  ASSERT_EQ(a.size(), b.size());
  EXPECT_EQ(std::memcmp(a.data(), b.data(), a.size() * sizeof(a[0])), 0);

  ClosestAnswer answer;
  answer.hits.resize(kRows, {0.123456789, 0.25, 0.3333, 123456});
  std::string encoded;
  timed("npy_encode", 200, [&] { encoded = EncodeClosest(answer, from_npy, {}, BatchType::kNpy); });
  timed("json_encode", 2000,
        [&] { encoded = EncodeClosest(answer, from_npy, {}, BatchType::kJson); });
}

}  // namespace
}  // namespace kdray::api
