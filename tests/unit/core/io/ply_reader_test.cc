// SPDX-License-Identifier: Apache-2.0
#include "core/io/ply_reader.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "core/io/ply_header.h"
#include "tests/support/seed.h"
#include "tests/unit/core/io/mesh_texts.h"

namespace kdray::core {
namespace {

using testing::ElementsAre;

const std::string kAscii = "ply\nformat ascii 1.0\n";
const std::string kVertices =
    "element vertex 4\nproperty float x\nproperty float y\nproperty float z\n";
const std::string kFaces = "element face 1\nproperty list uchar int vertex_indices\n";
const std::string kEnd = "end_header\n";
const std::string kSquare = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n";

std::string BinaryHeader(std::endian order) {
  return std::string("ply\nformat binary_") + (order == std::endian::big ? "big" : "little") +
         "_endian 1.0\n";
}

template <class T>
std::string RawSquare(std::endian order = std::endian::little) {
  std::string bytes;
  for (const T number : {T(0), T(0), T(0), T(1), T(0), T(0), T(1), T(1), T(0), T(0), T(1), T(0)}) {
    bytes += Raw(number, order);
  }
  return bytes;
}

void ExpectSquare(const MeshData& data) {
  EXPECT_EQ(data.format, MeshFormat::kPly);
  EXPECT_THAT(data.vertices,
              ElementsAre(Vec3d{0, 0, 0}, Vec3d{1, 0, 0}, Vec3d{1, 1, 0}, Vec3d{0, 1, 0}));
  EXPECT_THAT(data.triangles, ElementsAre(TriangleIndices{0, 1, 2}, TriangleIndices{0, 2, 3}));
}

TEST(PlyReader, ReadsAsciiFiles) {
  const MeshData data = MustRead(kAscii + kVertices + kFaces + kEnd + kSquare + "4 0 1 2 3\n");
  ExpectSquare(data);
  EXPECT_TRUE(data.single_precision);
}

TEST(PlyReader, ReadsBothByteOrders) {
  for (const std::endian order : {std::endian::little, std::endian::big}) {
    std::string file = BinaryHeader(order) + kVertices + kFaces + kEnd + RawSquare<float>(order) +
                       Raw<std::uint8_t>(4);
    for (const int index : {0, 1, 2, 3}) file += Raw<std::int32_t>(index, order);
    const MeshData data = MustRead(file);
    ExpectSquare(data);
    EXPECT_TRUE(data.single_precision);
  }
}

TEST(PlyReader, ReadsDoublesExactlyInEveryBody) {
  const std::string header =
      "element vertex 1\nproperty double x\nproperty float64 y\nproperty double z\nelement face "
      "1\nproperty list uchar uchar vertex_index\nend_header\n";
  const MeshData ascii =
      MustRead("ply\nformat ascii 1.0\n" + header + "500000.123 -0.1 1e30\n3 0 0 0\n");
  const MeshData binary = MustRead(BinaryHeader(std::endian::big) + header +
                                   Raw(500000.123, std::endian::big) + Raw(-0.1, std::endian::big) +
                                   Raw(1e30, std::endian::big) + std::string("\3\0\0\0", 4));
  EXPECT_THAT(ascii.vertices, ElementsAre(Vec3d{500000.123, -0.1, 1e30}));
  EXPECT_EQ(binary.vertices, ascii.vertices);
  EXPECT_FALSE(ascii.single_precision);
  EXPECT_FALSE(binary.single_precision);
}

std::string AsciiPoints(const std::string& rows, const std::string& types = "float float float") {
  std::string header = "element vertex 4\n";
  std::size_t at = 0;
  for (const char axis : {'x', 'y', 'z'}) {
    const std::size_t end = std::min(types.find(' ', at), types.size());
    header += "property " + types.substr(at, end - at) + " " + axis + "\n";
    at = end + 1;
  }
  return kAscii + header + kFaces + kEnd + rows + "3 0 1 2\n";
}

TEST(PlyReader, ReadsAsciiFloatsAsTheFloatsThatTheyWere) {
  for (const char* type : {"float float float", "float32 float32 float32"}) {
    const MeshData data =
        MustRead(AsciiPoints("0.1 0 -0\n0.333333 1e-3 16777216\n1 1 0\n0 1.17549e-38 0\n", type));
    EXPECT_EQ(data.vertices[0].x, static_cast<double>(0.1f));
    EXPECT_TRUE(std::signbit(data.vertices[0].z));
    EXPECT_EQ(data.vertices[1].x, static_cast<double>(0.333333f));
    EXPECT_EQ(data.vertices[1].y, static_cast<double>(1e-3f));
    EXPECT_TRUE(data.single_precision);
    EXPECT_FALSE(data.wider_than_declared);
  }
}

TEST(PlyReader, KeepsTheDoublesOfAnAsciiFileOfWhichOneNumberIsNoFloat) {
  for (const char* last :
       {"0.1000000000", "0.123456789012", "16777217", "1e39", "1e-50", "1e400"}) {
    SCOPED_TRACE(last);
    // The last vertex, which no face uses, counts as well.
    const MeshData data =
        MustRead(AsciiPoints("0.1 0 0\n1 0 0\n1 1 0\n0 1 " + std::string(last) + "\n"));
    EXPECT_EQ(data.vertices[0].x, 0.1);
    EXPECT_FALSE(data.single_precision);
    EXPECT_TRUE(data.wider_than_declared);
  }
}

TEST(PlyReader, TakesTheFloatsAmongDoublesAsFloats) {
  const MeshData data =
      MustRead(AsciiPoints("0.1 0.1 0\n1 0 0\n1 1 0\n0 1 nan\n", "float double float"));
  EXPECT_EQ(data.vertices[0], (Vec3d{static_cast<double>(0.1f), 0.1, 0}));
  EXPECT_FALSE(data.single_precision);
  EXPECT_FALSE(data.wider_than_declared);
}

TEST(PlyReader, ReadsAFloatMeshAlikeFromTextAndFromBytes) {
  std::mt19937_64 random = test::RandomEngine(31);
  for (const char* format : {"%.6g", "%.7g", "%.8g", "%.9g", "%.9e", "%.12f", "%.45f", "%.17g"}) {
    SCOPED_TRACE(format);
    std::string text;
    std::string bytes;
    for (int i = 0; i < 12; ++i) {
      const auto number = static_cast<float>(std::ldexp(static_cast<double>(random() >> 40),
                                                        static_cast<int>(random() % 20) - 24)) +
                          0x1p-20f;
      char word[160];
      std::snprintf(word, sizeof word, format, static_cast<double>(number));
      text += std::string(word) + (i % 3 == 2 ? "\n" : " ");
      // Few digits name another float, which is then what the file says.
      bytes += Raw(std::strtof(word, nullptr));
    }
    const MeshData ascii = MustRead(AsciiPoints(text));
    bytes += Raw<std::uint8_t>(3);
    for (const int index : {0, 1, 2}) bytes += Raw<std::int32_t>(index);
    const MeshData binary =
        MustRead(BinaryHeader(std::endian::little) + kVertices + kFaces + kEnd + bytes);
    EXPECT_EQ(ascii.vertices, binary.vertices);
    EXPECT_EQ(ascii.single_precision, binary.single_precision);
  }
}

template <class T>
class PlyIntegerTypes : public testing::Test {};
struct Int8 {
  using Type = std::int8_t;
  static constexpr const char* kName = "char";
};
struct Uint8 {
  using Type = std::uint8_t;
  static constexpr const char* kName = "uint8";
};
struct Int16 {
  using Type = std::int16_t;
  static constexpr const char* kName = "short";
};
struct Uint16 {
  using Type = std::uint16_t;
  static constexpr const char* kName = "uint16";
};
struct Int32 {
  using Type = std::int32_t;
  static constexpr const char* kName = "int32";
};
struct Uint32 {
  using Type = std::uint32_t;
  static constexpr const char* kName = "uint";
};
struct Int64 {
  using Type = std::int64_t;
  static constexpr const char* kName = "int64";
};
struct Uint64 {
  using Type = std::uint64_t;
  static constexpr const char* kName = "ulong";
};
using IntegerTypes = testing::Types<Int8, Uint8, Int16, Uint16, Int32, Uint32, Int64, Uint64>;
TYPED_TEST_SUITE(PlyIntegerTypes, IntegerTypes);

TYPED_TEST(PlyIntegerTypes, ServeAsCountsIndicesAndCoordinates) {
  using T = typename TypeParam::Type;
  const std::string type = TypeParam::kName;
  for (const std::endian order : {std::endian::little, std::endian::big}) {
    std::string file = BinaryHeader(order) + "element vertex 4\nproperty " + type +
                       " x\nproperty " + type + " y\nproperty " + type +
                       " z\nelement face 1\nproperty list " + type + " " + type +
                       " vertex_indices\n" + kEnd + RawSquare<T>(order);
    for (const T number : {T(4), T(0), T(1), T(2), T(3)}) file += Raw(number, order);
    const MeshData data = MustRead(file);
    ExpectSquare(data);
    EXPECT_FALSE(data.single_precision);
  }
}

TEST(PlyReader, FindsItsPropertiesInAnyOrderAmongOthers) {
  const std::string header =
      "obj_info made by hand\nelement camera 2\nproperty float a\nproperty list uchar short b\n"
      "element vertex 4\nproperty uchar red\nproperty float z\nproperty list uchar float weights\n"
      "property float x\nproperty float y\nelement face 1\nproperty list uchar float texcoord\n"
      "property list uchar int vertex_indices\nproperty int flags\nelement material 1\n"
      "property int unread\nend_header\n";
  ExpectSquare(
      MustRead(kAscii + header +
               "0.5 2 7 8\n0.5 0\n255 0 2 0.5 0.5 0 0\n255 0 0 1 0\n255 0 0 1 1\n255 0 1 9 0 1\n"
               "2 0.5 0.5 4 0 1 2 3 77\n"));
  std::string binary = BinaryHeader(std::endian::little) + header;
  binary += Raw(0.5f) + Raw<std::uint8_t>(2) + Raw<std::int16_t>(7) + Raw<std::int16_t>(8);
  binary += Raw(0.5f) + Raw<std::uint8_t>(0);
  for (const auto& [x, y] : {std::pair(0.f, 0.f), {1.f, 0.f}, {1.f, 1.f}, {0.f, 1.f}}) {
    binary += Raw<std::uint8_t>(255) + Raw(0.f) + Raw<std::uint8_t>(1) + Raw(9.f) + Raw(x) + Raw(y);
  }
  binary += Raw<std::uint8_t>(1) + Raw(0.5f) + Raw<std::uint8_t>(4);
  for (const int index : {0, 1, 2, 3}) binary += Raw<std::int32_t>(index);
  binary += Raw<std::int32_t>(77);
  ExpectSquare(MustRead(binary));
}

TEST(PlyReader, ReadsFacesThatComeBeforeTheVertices) {
  ExpectSquare(MustRead(kAscii + kFaces + kVertices + kEnd + "4 0 1 2 3\n" + kSquare));
}

TEST(PlyReader, TakesAnyLineEndAndADataByteThatLooksLikeOne) {
  for (const std::string end : {"\n", "\r\n", "\r"}) {
    std::string ascii;
    for (const char c : kAscii + kVertices + kFaces + kEnd + kSquare + "\n4 0 1 2 3") {
      ascii += c == '\n' ? end : std::string(1, c);
    }
    ExpectSquare(MustRead(ascii));
    std::string binary;
    for (const char c : BinaryHeader(std::endian::little) +
                            "element vertex 1\nproperty uchar x\n"
                            "property uchar y\nproperty uchar z\nelement face 1\n"
                            "property list uchar uchar vertex_indices\n" +
                            kEnd) {
      binary += c == '\n' ? end : std::string(1, c);
    }
    const MeshData data = MustRead(binary + std::string("\n\r\n\3\0\0\0", 7));
    EXPECT_THAT(data.vertices, ElementsAre(Vec3d{10, 13, 10}));
  }
}

TEST(PlyReader, IgnoresWhatFollowsOnALineAndBehindTheLastElement) {
  ExpectSquare(MustRead(kAscii + kVertices + kFaces + kEnd +
                        "0 0 0 9 9\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3 255 0 0\ntrailing words\n"));
  std::string binary = BinaryHeader(std::endian::little) + kVertices + kFaces + kEnd +
                       RawSquare<float>() + Raw<std::uint8_t>(4);
  for (const int index : {0, 1, 2, 3}) binary += Raw<std::int32_t>(index);
  ExpectSquare(MustRead(binary + std::string(100, '\0')));
}

TEST(PlyReader, DropsAndCountsFacesWithFewerThanThreeCorners) {
  const MeshData data =
      MustRead(kAscii + kVertices + "element face 4\nproperty list uchar int vertex_indices\n" +
               kEnd + kSquare + "0\n1 0\n2 0 1\n3 0 1 2\n");
  EXPECT_EQ(data.triangles.size(), 1u);
  EXPECT_EQ(data.dropped, 3u);
}

TEST(PlyReader, IgnoresHeaderWordsInComments) {
  ExpectSquare(MustRead(kAscii + "comment end_header\ncomment element face 9\n" + kVertices +
                        kFaces + kEnd + kSquare + "4 0 1 2 3\n"));
}

TEST(PlyReader, NamesTheLineOfABrokenHeader) {
  struct Case {
    std::string text;
    std::uint64_t line;
    const char* message;
  };
  const std::string many(1100, 'p');
  std::string properties;
  for (int i = 0; i < 1100; ++i) properties += "property char p" + std::to_string(i) + "\n";
  for (const Case& c : {
           Case{"ply\nformat ascii 1.0\n" + kVertices, 7,
                "line 7: the PLY header has no end_header"},
           Case{"ply\n" + kVertices + kEnd, 6, "line 6: the PLY header has no format line"},
           Case{"ply\nformat ascii 1.1\n" + kEnd, 2, "line 2: the format's version is not 1.0"},
           Case{"ply\nformat middle 1.0\n" + kEnd, 2,
                "line 2: 'middle' is not a format; allowed are ascii, binary_little_endian, "
                "binary_big_endian"},
           Case{kAscii + "format ascii 1.0\n", 3, "line 3: a second format line"},
           Case{kAscii + "element vertex -8\n", 3, "line 3: an element cannot have '-8' rows"},
           Case{kAscii + "element vertex 10000000000000000000\n", 3,
                "line 3: '10000000000000000000' is not an integer of 64 bits"},
           Case{kAscii + "element\n", 3, "line 3: the element has no name"},
           Case{kAscii + "element vertex\n", 3, "line 3: an integer is missing"},
           Case{kAscii + kVertices + kVertices, 7, "line 7: a second element 'vertex'"},
           Case{kAscii + "property float x\n", 3, "line 3: a property without an element"},
           Case{kAscii + "element vertex 4\nproperty half x\n", 4,
                "line 4: 'half' is not a type of PLY"},
           Case{kAscii + "element vertex 4\nproperty float\n", 4,
                "line 4: the property has no name"},
           Case{kAscii + kVertices + "property float x\n" + kFaces + kEnd, 7,
                "line 7: a second property 'x'"},
           Case{kAscii + kVertices + kFaces + "property list uchar int vertex_indices\n" + kEnd, 9,
                "line 9: a second property 'vertex_indices'"},
           Case{kAscii + kVertices + "propery uchar red\n", 7,
                "line 7: 'propery' does not begin a line of a PLY header; allowed are format, "
                "element, "
                "property, comment, obj_info, end_header"},
           Case{kAscii + "elemnt face 12\n", 3,
                "line 3: 'elemnt' does not begin a line of a PLY header; allowed are format, "
                "element, "
                "property, comment, obj_info, end_header"},
           Case{kAscii + "element face 4\nproperty list float int vertex_indices\n", 4,
                "line 4: 'float' is not an integer type, which a list's length must have"},
           Case{kAscii + "a\x01"
                         "b\n",
                3,
                "line 3: 'a\\x01b' does not begin a line of a PLY header; allowed are format, "
                "element, "
                "property, comment, obj_info, end_header"},
           Case{kAscii + "element vertex 1\n" + properties, 1027,
                "line 1027: more than 1024 elements and properties"},
           Case{kAscii + "element vertex 4\nproperty float x\nproperty float y\n" + kFaces + kEnd,
                3, "line 3: the element 'vertex' has no number 'z'"},
           Case{kAscii + kFaces + kEnd, 3, "line 3: there are faces but no element 'vertex'"},
           Case{kAscii + kVertices + "element face 1\nproperty list uchar float vertex_indices\n" +
                    kEnd,
                7,
                "line 7: the element 'face' has no list of integers 'vertex_indices' or "
                "'vertex_index'"},
       }) {
    ExpectInvalidAtLine(c.text, c.line, c.message);
  }
}

TEST(PlyReader, NamesTheLineOfABrokenAsciiBody) {
  const std::string header = kAscii + kVertices + kFaces + kEnd;  // 9 lines
  struct Case {
    std::string body;
    std::uint64_t line;
    const char* message;
  };
  for (const Case& c : {
           Case{"0 0 0\n1 0 0\n1 1\n0 1 0\n4 0 1 2 3\n", 12, "line 12: a number is missing"},
           Case{"0 0 0\n1 0 x\n1 1 0\n0 1 0\n4 0 1 2 3\n", 11, "line 11: 'x' is not a number"},
           Case{"0 0 0\n1 0 nan\n1 1 0\n0 1 0\n4 0 1 2 3\n", 11,
                "line 11: z of vertex 2 (counted from 1), which a face uses: the coordinate 'nan' "
                "is "
                "not finite"},
           Case{kSquare, 14, "line 14: the file ends before its last row"},
           Case{kSquare + "   \n", 15, "line 15: the file ends before its last row"},
           Case{kSquare + "4 0 1 2 4\n", 14,
                "line 14: vertex 4 does not exist; the file has 4, counted from 0"},
           Case{kSquare + "4 0 1 2 -1\n", 14,
                "line 14: vertex -1 does not exist; the file has 4, counted from 0"},
           Case{kSquare + "4 0 1 2 3.0\n", 14, "line 14: '3.0' is not an integer of 64 bits"},
           Case{kSquare + "4 0 1 2\n\n\n", 14, "line 14: a number is missing"},
           Case{kSquare + "-4 0 1 2 3\n", 14, "line 14: a list cannot have -4 items"},
           Case{kSquare + "4294967295 0 1 2 3\n", 14,
                "line 14: a list of 4294967295 items does not fit into the 9 bytes that follow"},
       }) {
    ExpectInvalidAtLine(header + c.body, c.line, c.message);
  }
}

TEST(PlyReader, NamesTheByteOfABrokenBinaryBody) {
  const std::string header = BinaryHeader(std::endian::little) + kVertices +
                             "element face 1\nproperty list uchar int vertex_indices\n" + kEnd +
                             RawSquare<float>();
  const auto face = [](int a, int b, int c) {
    return Raw<std::uint8_t>(3) + Raw<std::int32_t>(a) + Raw<std::int32_t>(b) +
           Raw<std::int32_t>(c);
  };
  const std::uint64_t body = header.size();
  ExpectInvalidAtByte(header + face(0, 1, 4), body + 9,
                      "byte " + std::to_string(body + 9) +
                          ": vertex 4 does not exist; the file has 4, counted from 0");
  ExpectInvalidAtByte(header + face(-1, 1, 2), body + 1,
                      "byte " + std::to_string(body + 1) +
                          ": vertex -1 does not exist; the file has 4, counted from 0");
  ExpectInvalidAtByte(header + face(0, 1, 2).substr(0, 12), body,
                      "byte " + std::to_string(body) +
                          ": a list of 3 items does not fit into the 11 bytes that follow");
}

TEST(PlyReader, NamesTheHeaderLineOfACountThatTheFileCannotHold) {
  const std::string vertex = "property float x\nproperty float y\nproperty float z\n";
  ExpectInvalidAtLine(
      BinaryHeader(std::endian::little) + "element vertex 4294967295\n" + vertex + kFaces + kEnd +
          RawSquare<float>(),
      3,
      "line 3: the element 'vertex' claims 4294967295 rows of at least 12 bytes; 48 "
      "bytes are left");
  ExpectInvalidAtLine(kAscii + kVertices +
                          "element face 4000000000\nproperty list uchar int vertex_indices\n" +
                          kEnd + kSquare + "3 0 1 2\n",
                      7,
                      "line 7: the element 'face' claims 4000000000 rows of at least 2 bytes; 9 "
                      "bytes are left");
  ExpectInvalidAtLine(BinaryHeader(std::endian::little) + "element vertex 9223372036854775807\n" +
                          vertex + kFaces + kEnd + RawSquare<float>(),
                      3,
                      "line 3: the element 'vertex' claims 9223372036854775807 rows of at least 12 "
                      "bytes; 48 bytes are left");
}

TEST(PlyReader, PassesElementsWithoutPropertiesWhateverTheirCount) {
  ExpectSquare(MustRead(kAscii + "element nothing 9223372036854775807\n" + kVertices + kFaces +
                        kEnd + kSquare + "4 0 1 2 3\n"));
}

TEST(PlyReader, ReadsTriangleStripsWhereThereIsNoFace) {
  for (const char* face : {"", "element face 0\nproperty list uchar int vertex_indices\n"}) {
    const MeshData data = MustRead(kAscii + kVertices + face +
                                   "element tristrips 2\nproperty list int int vertex_indices\n" +
                                   kEnd + kSquare + "9 0 1 2 3 -1 3 2 -1 0\n3 0 2 3\n");
    EXPECT_THAT(data.triangles, ElementsAre(TriangleIndices{0, 1, 2}, TriangleIndices{2, 1, 3},
                                            TriangleIndices{0, 2, 3}));
  }
  const std::string strips = kAscii + kVertices +
                             "element tristrips 1\nproperty list int int vertex_indices\n" + kEnd +
                             kSquare;
  ExpectInvalidAtLine(strips + "3 0 1 4\n", 14,
                      "line 14: vertex 4 does not exist; the file has 4, counted from 0");
  ExpectInvalidAtLine(strips + "3 0 1 -2\n", 14,
                      "line 14: vertex -2 does not exist; the file has 4, counted from 0");
  EXPECT_EQ(MustRefuse(strips + "4 0 1 -1 2\n").code, ErrorCode::kEmptyMesh);
}

TEST(PlyReader, ReadsTheBodyOfATextAsWordsOnAnyLines) {
  const std::string header = kAscii + kVertices + "property float nx\n" +
                             "element face 2\nproperty list uchar int vertex_indices\n" + kEnd;
  for (const std::string& body : std::vector<std::string>{
           "0 0 0\n9\n1 0 0\n9\n1 1 0\n9\n0 1 0\n9\n3 0 1 2\n3 0 2 3\n",
           "0 0 0 9 1 0 0 9 1 1 0 9 0 1 0 9 3 0 1 2 3 0 2 3",
           "0 0 0 9 1 0\n0 9 1 1 0 9\n0 1 0 9 3 0\n1 2 3 0 2 3\n",
           "0 0 0 9 1 0\n0 9 1 1 0 9\n0 1 0 9\n3\n0\n1\n2\n3\n0\n2\n3\n",
           "0 0 0 9\n1 0 0 9\n1 1 0 9\n0 1 0 9\n3 0\n1 2\n3 0 2 3\n",
           "0 0 0 9\ncomment second\n1 0 0 9\nobj_info 3\n1 1 0 9\n0 1 0 9\n# faces\n3 0 1 2\n"
           "comment\n3 0 2 3\n",
           "0 0\ncomment 7 7\n0 9\n1 0 0 9\n1 1 0 9\n0 1 0 9\n3 0 1 2\n3 0 2 3\n",
           "0 0 0 9 8 7\n1 0 0 9\n1 1 0 9\n0 1 0 9 5\n3 0 1 2\n3 0 2 3 255 0 0\n",
           "0 0 0 9\n1 0 0 9\n1 1 0 9\n0 1 0 9\n3 0 1 2\n3 0 2 3\n\x1a",
       }) {
    SCOPED_TRACE(body);
    ExpectSquare(MustRead(header + body));
  }
}

TEST(PlyReader, NeverFillsAMissingNumberWithTheNextRows) {
  const std::string header =
      kAscii + kVertices + "element face 3\nproperty list uchar int vertex_indices\n" + kEnd;
  const std::vector<std::string> good = {"0 0 0",   "1 0 0",   "1 1 0",  "0 1 0",
                                         "3 2 1 0", "3 0 2 3", "3 3 3 3"};
  const auto file = [&](const std::vector<std::string>& lines, const std::string& end) {
    std::string text = header;
    for (const std::string& line : lines) text += line + "\n";
    return text + end;
  };
  for (const std::string end : {"", "trailing words\n"}) {
    MustRead(file(good, end));
    for (std::size_t i = 0; i < good.size(); ++i) {
      std::vector<std::string> lines = good;
      lines.erase(lines.begin() + static_cast<std::ptrdiff_t>(i));
      EXPECT_EQ(MustRefuse(file(lines, end)).code, ErrorCode::kInvalidMesh) << file(lines, end);
      lines = good;
      lines[i].resize(lines[i].rfind(' '));
      EXPECT_EQ(MustRefuse(file(lines, end)).code, ErrorCode::kInvalidMesh) << file(lines, end);
      const std::optional<std::uint64_t> line = MustRefuse(file(lines, end)).line;
      EXPECT_TRUE(!end.empty() || line == i + 10);
    }
  }
}

TEST(PlyReader, PassesWhatItDoesNotNeedWhateverItIs) {
  const std::string more =
      "property long a\nproperty uint64 b\nproperty list uchar int64 c\n"
      "property float q\nproperty float q\n";
  const std::string ascii_row = " -9223372036854775808 18446744073709551615 1 7 1 2\n";
  std::string rows;
  for (const char* row : {"0 0 0", "1 0 0", "1 1 0", "0 1 0"}) rows += row + ascii_row;
  ExpectSquare(MustRead(kAscii + "Created by a program\n" + kVertices + more +
                        "made on a Monday\n" + kFaces + kEnd + rows + "4 0 1 2 3\n"));
  std::string binary = BinaryHeader(std::endian::big) + kVertices + more + kFaces + kEnd;
  for (const auto& [x, y] : {std::pair(0.f, 0.f), {1.f, 0.f}, {1.f, 1.f}, {0.f, 1.f}}) {
    for (const float number : {x, y, 0.f}) binary += Raw(number, std::endian::big);
    binary += std::string(16, '\xff') + "\1" + std::string(8, '\7') + std::string(8, '\7');
  }
  binary += Raw<std::uint8_t>(4);
  for (const int index : {0, 1, 2, 3}) binary += Raw<std::int32_t>(index, std::endian::big);
  ExpectSquare(MustRead(binary));
}

TEST(PlyReader, RefusesAnIndexOf64BitsThatNoVertexHas) {
  const std::string header = BinaryHeader(std::endian::little) + kVertices +
                             "element face 1\nproperty list uchar uint64 vertex_indices\n" + kEnd +
                             RawSquare<float>() + "\3";
  for (const std::uint64_t index : {std::uint64_t{4}, std::uint64_t{1} << 32, ~std::uint64_t{0}}) {
    const Error error =
        MustRefuse(header + Raw<std::uint64_t>(0) + Raw<std::uint64_t>(1) + Raw(index));
    EXPECT_EQ(error.code, ErrorCode::kInvalidMesh);
    EXPECT_EQ(error.byte, header.size() + 16);
  }
}

TEST(PlyReader, CallsAFileWithoutTrianglesEmpty) {
  for (const std::string& text :
       {kAscii + kEnd, kAscii + kVertices + kEnd + kSquare,
        kAscii + kVertices + "element face 0\nproperty list uchar int vertex_indices\n" + kEnd,
        kAscii + kVertices + kFaces + kEnd + kSquare + "2 0 1\n"}) {
    EXPECT_EQ(MustRefuse(text).code, ErrorCode::kEmptyMesh) << text;
  }
}

TEST(PlyReader, AllowsAnyCoordinateOnlyInAVertexThatNoFaceUses) {
  const std::string ascii = kAscii + kVertices + kFaces + kEnd + "0 0 0\n1 0 0\n1 1 0\n";
  const std::string header = BinaryHeader(std::endian::little) + kVertices + kFaces + kEnd;
  std::string binary = header;
  for (int i = 0; i < 9; ++i) binary += Raw(static_cast<float>(i * i % 5));
  binary += Raw(1.f) + Raw(NAN) + Raw(INFINITY) + Raw<std::uint8_t>(3);
  for (const int last : {2, 3}) {
    const std::string corners =
        Raw<std::int32_t>(0) + Raw<std::int32_t>(1) + Raw<std::int32_t>(last);
    const std::string text = ascii + "1 nan inf\n3 0 1 " + std::to_string(last) + "\n";
    if (last == 2) {
      EXPECT_TRUE(std::isnan(MustRead(binary + corners).vertices[3].y));
      EXPECT_TRUE(std::isnan(MustRead(text).vertices[3].y));
      EXPECT_TRUE(MustRead(text).single_precision);
    } else {
      const std::string what =
          "y of vertex 4 (counted from 1), which a face uses: the coordinate 'nan' is not finite";
      ExpectInvalidAtLine(text, 13, "line 13: " + what);
      const std::size_t byte = header.size() + 40;
      ExpectInvalidAtByte(binary + corners, byte, "byte " + std::to_string(byte) + ": " + what);
    }
  }
}

}  // namespace
}  // namespace kdray::core
