#include "core/io/ply_reader.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "core/io/ply_header.h"
#include "tests/unit/core/mesh_texts.h"

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
      MustRead("ply\nformat ascii 1.0\n" + header + "500000.123 -0.1 1e300\n3 0 0 0\n");
  const MeshData binary = MustRead(BinaryHeader(std::endian::big) + header +
                                   Raw(500000.123, std::endian::big) + Raw(-0.1, std::endian::big) +
                                   Raw(1e300, std::endian::big) + std::string("\3\0\0\0", 4));
  EXPECT_THAT(ascii.vertices, ElementsAre(Vec3d{500000.123, -0.1, 1e300}));
  EXPECT_EQ(binary.vertices, ascii.vertices);
  EXPECT_FALSE(ascii.single_precision);
  EXPECT_FALSE(binary.single_precision);
}

TEST(PlyReader, ReadsTheNumbersOfAnAsciiFloatPropertyAsDoubles) {
  const MeshData data =
      MustRead(kAscii + kVertices + kFaces + kEnd + "0.1 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2\n");
  EXPECT_EQ(data.vertices[0].x, 0.1);
  EXPECT_TRUE(data.single_precision);
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
using IntegerTypes = testing::Types<Int8, Uint8, Int16, Uint16, Int32, Uint32>;
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
                "line 2: 'middle' is not a format; there are ascii, binary_little_endian, "
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
           Case{kAscii + "element vertex 4\nproperty float x\nproperty float x\n", 5,
                "line 5: a second property 'x'"},
           Case{kAscii + "element face 4\nproperty list float int vertex_indices\n", 4,
                "line 4: 'float' is not an integer type, which a list's length must have"},
           Case{kAscii + "elephant\n", 3, "line 3: 'elephant' begins no line of a PLY header"},
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
                "line 11: 'nan' is not a finite number"},
           Case{kSquare, 7,
                "line 7: the element 'face' claims 1 rows of at least 2 bytes; 0 bytes are left"},
           Case{kSquare + "   \n", 15, "line 15: the file ends before its last row"},
           Case{kSquare + "4 0 1 2 4\n", 14,
                "line 14: vertex 4 does not exist; the file has 4, counted from 0"},
           Case{kSquare + "4 0 1 2 -1\n", 14,
                "line 14: vertex -1 does not exist; the file has 4, counted from 0"},
           Case{kSquare + "4 0 1 2 3.0\n", 14, "line 14: '3.0' is not an integer of 64 bits"},
           Case{kSquare + "4 0 1 2\n\n\n", 14, "line 14: a number is missing"},
           Case{kSquare + "-4 0 1 2 3\n", 14, "line 14: a list cannot have -4 items"},
           Case{kSquare + "4294967295 0 1 2 3\n", 14,
                "line 14: a list of 4294967295 items does not fit into the 9 bytes that are left"},
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
                          ": a list of 3 items does not fit into the 11 bytes that are left");
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
                      "line 7: the element 'face' claims 4000000000 rows of at least 2 bytes; 8 "
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

TEST(PlyReader, RefusesTriangleStripsAsNotReadRatherThanBroken) {
  const Error error = MustRefuse(kAscii + kVertices +
                                 "element tristrips 1\nproperty list int int vertex_indices\n" +
                                 kEnd + kSquare + "4 0 1 2 3\n");
  EXPECT_EQ(error.code, ErrorCode::kUnsupportedMeshFormat);
  EXPECT_EQ(error.line, 7u);
}

TEST(PlyReader, CallsAFileWithoutTrianglesEmpty) {
  for (const std::string& text :
       {kAscii + kEnd, kAscii + kVertices + kEnd + kSquare,
        kAscii + kVertices + "element face 0\nproperty list uchar int vertex_indices\n" + kEnd,
        kAscii + kVertices + kFaces + kEnd + kSquare + "2 0 1\n"}) {
    EXPECT_EQ(MustRefuse(text).code, ErrorCode::kEmptyMesh) << text;
  }
}

TEST(PlyReader, LeavesNonFiniteVerticesToTheMesh) {
  // Only a vertex that triangles use must be finite, and the reader does not know which those are.
  std::string file = BinaryHeader(std::endian::little) + kVertices + kFaces + kEnd;
  for (int i = 0; i < 9; ++i) file += Raw(static_cast<float>(i * i % 5));
  file += Raw(NAN) + Raw(NAN) + Raw(NAN) + Raw<std::uint8_t>(3);
  for (const int index : {0, 1, 2}) file += Raw<std::int32_t>(index);
  EXPECT_TRUE(std::isnan(MustRead(file).vertices[3].x));
}

}  // namespace
}  // namespace kdray::core
