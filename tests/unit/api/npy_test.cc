// SPDX-License-Identifier: Apache-2.0
#include "api/npy.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>
#include <string>
#include <vector>

#include "tests/support/seed.h"
#include "tests/unit/api/npy_bytes.h"

namespace kdray::api {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

constexpr std::string_view kTwoByThree =
    "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3), }";

TEST(Npy, ReadsTypeOrderShapeAndElements) {
  for (const int version : {1, 2, 3}) {
    const std::string file = NpyFile(kTwoByThree, Bytes(Counted<float>(6)), version);
    const Outcome<NpyArray> array = ReadNpy(file);
    ASSERT_TRUE(array) << array.problem().detail;
    EXPECT_EQ(array->type, NumberType::kF4);
    EXPECT_FALSE(array->fortran_order);
    EXPECT_THAT(array->shape, ElementsAre(2, 3));
    EXPECT_EQ(array->data, Bytes(Counted<float>(6)));
  }
}

TEST(Npy, ReadsEveryWayToWriteTheSameHeader) {
  for (const char* header : {
           "{'descr':'<f8','fortran_order':True,'shape':(2,3)}",
           "{\"shape\": (2L, 3L,), \"descr\": \"<f8\", \"fortran_order\": True}   \n",
           " { 'fortran_order' :\tTrue , 'shape' : ( 2 , 3 ) ,\n 'descr' : '<f8' , } \n",
       }) {
    const Outcome<NpyArray> array = ReadNpy(NpyFile(header, Bytes(Counted<double>(6))));
    ASSERT_TRUE(array) << header << ": " << array.problem().detail;
    EXPECT_EQ(array->type, NumberType::kF8);
    EXPECT_TRUE(array->fortran_order);
    EXPECT_THAT(array->shape, ElementsAre(2, 3));
  }
}

TEST(Npy, ReadsShapesOfAnyRank) {
  const auto shape_of = [](std::string shape, std::size_t elements) {
    const Outcome<NpyArray> array =
        ReadNpy(NpyFile("{'descr': '<f4', 'fortran_order': False, 'shape': " + shape + "}",
                        Bytes(Counted<float>(elements))));
    EXPECT_TRUE(array) << shape << ": " << array.problem().detail;
    return array ? array->shape : std::vector<std::size_t>{999};
  };
  EXPECT_THAT(shape_of("()", 1), IsEmpty());
  EXPECT_THAT(shape_of("(6,)", 6), ElementsAre(6));
  EXPECT_THAT(shape_of("(0, 6)", 0), ElementsAre(0, 6));
  EXPECT_THAT(shape_of("(0,)", 0), ElementsAre(0));
  std::string ones = "(";
  for (int i = 0; i < 33; ++i) ones += "1, ";
  EXPECT_EQ(shape_of(ones + ")", 1).size(), 33u);
}

TEST(Npy, SaysWhatArchivesAreAndWhatToSend) {
  const auto detail = [](std::string_view body) { return ReadNpy(body).problem().detail; };
  EXPECT_THAT(detail("PK\x03\x04rest"),
              HasSubstr("perhaps an .npz file; send one array as an .npy"));
  EXPECT_THAT(detail("\x1f\x8b\x08rest"), HasSubstr("gzip data; send the .npy file itself"));
}

TEST(Npy, RefusesWhatIsNoHeaderOfFloats) {
  struct Case {
    std::string_view header, detail;
  };
  const Case cases[] = {
      {"", "'{' was expected at its byte 0"},
      {"{", "a key in quotes or '}'"},
      {"{}", "no 'descr'"},
      {"{'descr': '<f4', 'fortran_order': False}", "no 'shape'"},
      {"{'descr': '<f4', 'shape': (2, 3)}", "no 'fortran_order'"},
      {"{'fortran_order': False, 'shape': (2, 3)}", "no 'descr'"},
      {"{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3), 'x': 1}", "unknown key 'x'"},
      {"{'descr': '<f4', 'descr': '<f4', 'fortran_order': False, 'shape': (2, 3)}", "twice"},
      {"{'descr': '>f4', 'fortran_order': False, 'shape': (2, 3)}", "'>f4'; send"},
      {"{'descr': '>f8', 'fortran_order': False, 'shape': (2, 3)}", "'>f8'; send"},
      {"{'descr': '=f4', 'fortran_order': False, 'shape': (2, 3)}", "'=f4'; send"},
      {"{'descr': 'f4', 'fortran_order': False, 'shape': (2, 3)}", "'f4'; send"},
      {"{'descr': '<f2', 'fortran_order': False, 'shape': (2, 3)}", "'<f2'; send"},
      {"{'descr': '<i4', 'fortran_order': False, 'shape': (2, 3)}", "'<i4'; send"},
      {"{'descr': '<i8', 'fortran_order': False, 'shape': (2, 3)}", "'<i8'; send"},
      {"{'descr': '|b1', 'fortran_order': False, 'shape': (2, 3)}", "'|b1'; send"},
      {"{'descr': '|O', 'fortran_order': False, 'shape': (2, 3)}", "'|O'; send"},
      {"{'descr': '<c8', 'fortran_order': False, 'shape': (2, 3)}", "'<c8'; send"},
      {"{'descr': '<f4\\x00', 'fortran_order': False, 'shape': (2, 3)}", "the type in quotes"},
      {"{'descr': [('t', '<f4')], 'fortran_order': False, 'shape': (2, 3)}", "structured"},
      {"{'descr': ('<f4', (6,)), 'fortran_order': False, 'shape': (2, 3)}", "structured"},
      {"{'descr': <f4, 'fortran_order': False, 'shape': (2, 3)}", "the type in quotes"},
      {"{'descr': '<f4, 'fortran_order': False, 'shape': (2, 3)}", "'<f4, '"},
      {"{'descr': '<f4', 'fortran_order': 0, 'shape': (2, 3)}", "True or False"},
      {"{'descr': '<f4', 'fortran_order': false, 'shape': (2, 3)}", "True or False"},
      {"{'descr': '<f4', 'fortran_order': 'False', 'shape': (2, 3)}", "True or False"},
      {"{'descr': '<f4', 'fortran_order': Falsehood, 'shape': (2, 3)}", "',' or '}'"},
      {"{'descr': '<f4', 'fortran_order': False, 'shape': [2, 3]}", "shape's '('"},
      {"{'descr': '<f4', 'fortran_order': False, 'shape': 6}", "shape's '('"},
      {"{'descr': '<f4', 'fortran_order': False, 'shape': (6)}", "one dimension"},
      {"{'descr': '<f4', 'fortran_order': False, 'shape': (2, -3)}", "a length"},
      {"{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3.0)}", "',' or ')'"},
      {"{'descr': '<f4', 'fortran_order': False, 'shape': (,)}", "a length"},
      {"{'descr': '<f4', 'fortran_order': False, 'shape': (2,, 3)}", "a length"},
      {"{'descr': '<f4', 'fortran_order': False, 'shape': (2 3)}", "',' or ')'"},
      {"{'descr': '<f4', 'fortran_order': False, 'shape': (99999999999999999999, 6)}", "a length"},
      {"{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3)", "',' or '}'"},
      {"{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3)} x", "the end of the header"},
      {"{'descr': '<f4' 'fortran_order': False, 'shape': (2, 3)}", "',' or '}'"},
      {"{'descr' '<f4', 'fortran_order': False, 'shape': (2, 3)}", "a ':'"},
      {"{,}", "a key in quotes or '}'"},
      {"__import__('os').system('true')", "'{' was expected at its byte 0"},
  };
  for (const Case& c : cases) {
    const Outcome<NpyArray> array = ReadNpy(NpyFile(c.header, Bytes(Counted<float>(6))));
    ASSERT_FALSE(array) << c.header;
    EXPECT_EQ(array.problem().code, ErrorCode::kInvalidArray) << c.header;
    EXPECT_THAT(array.problem().detail, HasSubstr(c.detail)) << c.header;
  }
}

TEST(Npy, RefusesMoreThan33Dimensions) {
  std::string header = "{'descr': '<f4', 'fortran_order': False, 'shape': (";
  for (int i = 0; i < 34; ++i) header += "1, ";
  const Outcome<NpyArray> array = ReadNpy(NpyFile(header + ")}", Bytes(Counted<float>(1))));
  ASSERT_FALSE(array);
  EXPECT_THAT(array.problem().detail, HasSubstr("more than 33 dimensions"));
}

TEST(Npy, RefusesVersionsThatDoNotExist) {
  for (const int version : {0, 4, 255}) {
    EXPECT_FALSE(ReadNpy(NpyFile(kTwoByThree, Bytes(Counted<float>(6)), version))) << version;
  }
  std::string minor = NpyFile(kTwoByThree, Bytes(Counted<float>(6)));
  minor[7] = 1;
  const Outcome<NpyArray> array = ReadNpy(minor);
  ASSERT_FALSE(array);
  EXPECT_THAT(array.problem().detail, HasSubstr("version is 1.1"));
}

TEST(Npy, RefusesShapesThatOverflow) {
  for (const char* shape :
       {"(4611686018427387904, 6)", "(18446744073709551615, 18446744073709551615)",
        "(0, 18446744073709551615, 6)", "(3074457345618258603, 6)"}) {
    const Outcome<NpyArray> array = ReadNpy(NpyFile(
        "{'descr': '<f4', 'fortran_order': False, 'shape': " + std::string(shape) + "}", ""));
    ASSERT_FALSE(array) << shape;
    EXPECT_THAT(array.problem().detail, HasSubstr("overflows")) << shape;
  }
}

TEST(Npy, RefusesOneByteTooFewOrTooMany) {
  const std::string data = Bytes(Counted<float>(6));
  EXPECT_FALSE(ReadNpy(NpyFile(kTwoByThree, data.substr(1))));
  const Outcome<NpyArray> more = ReadNpy(NpyFile(kTwoByThree, data + "x"));
  ASSERT_FALSE(more);
  EXPECT_THAT(more.problem().detail, HasSubstr("make 24 bytes, and 25 follow"));
}

TEST(Npy, RefusesEveryPrefixOfAFile) {
  for (const int version : {1, 2}) {
    const std::string file = NpyFile(kTwoByThree, Bytes(Counted<float>(6)), version);
    for (std::size_t size = 0; size < file.size(); ++size) {
      // A separate copy, so a sanitizer detects any read after the end.
      const std::vector<char> prefix(file.begin(),
                                     file.begin() + static_cast<std::ptrdiff_t>(size));
      const Outcome<NpyArray> array = ReadNpy({prefix.data(), prefix.size()});
      ASSERT_FALSE(array) << size;
      EXPECT_EQ(array.problem().code, ErrorCode::kInvalidArray) << size;
    }
  }
}

TEST(Npy, SurvivesDamagedBytesAndBelievesOnlyTheBytesThatAreThere) {
  auto random = test::RandomEngine(1001);
  const std::string file = NpyFile(kTwoByThree, Bytes(Counted<float>(6)), 2);
  for (int round = 0; round < 100000; ++round) {
    std::vector<char> damaged(file.begin(), file.end());
    for (std::uint64_t flips = 1 + random() % 4; flips > 0; --flips) {
      damaged[random() % damaged.size()] = static_cast<char>(random());
    }
    const Outcome<NpyArray> array = ReadNpy({damaged.data(), damaged.size()});
    if (!array) continue;
    EXPECT_LE(array->data.size(), damaged.size());
    EXPECT_LE(array->shape.size(), 33u);
  }
}

TEST(NpyHeader, IsPaddedTo64BytesAndReadsBack) {
  const std::vector<std::vector<std::size_t>> shapes = {
      {}, {6}, {0}, {1000000, 6}, {2, 3, 4, 5}, std::vector<std::size_t>(33, 1)};
  for (const std::vector<std::size_t>& shape : shapes) {
    std::size_t elements = 1;
    for (const std::size_t length : shape) elements *= length;
    std::string file = NpyHeader("'<f8'", shape);
    EXPECT_EQ(file.size() % 64, 0u);
    EXPECT_EQ(file.back(), '\n');
    file += Bytes(Counted<double>(elements));
    const Outcome<NpyArray> array = ReadNpy(file);
    ASSERT_TRUE(array) << array.problem().detail;
    EXPECT_EQ(array->shape, shape);
    EXPECT_EQ(array->type, NumberType::kF8);
    EXPECT_FALSE(array->fortran_order);
  }
}

TEST(NpyHeader, IsWhatNumpyWrites) {
  const std::vector<std::size_t> shape = {5, 6};
  const std::string text = "{'descr': '<f4', 'fortran_order': False, 'shape': (5, 6), }";
  std::string wanted("\x93NUMPY\x01\x00\x76\x00", 10);
  wanted += text;
  wanted.resize(127, ' ');
  wanted += '\n';
  EXPECT_EQ(NpyHeader("'<f4'", shape), wanted);
}

}  // namespace
}  // namespace kdray::api
