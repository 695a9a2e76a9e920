// SPDX-License-Identifier: Apache-2.0
#include "core/io/stl_reader.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "tests/unit/core/io/mesh_texts.h"

namespace kdray::core {
namespace {

using testing::ElementsAre;

std::string Record(float first = 0) {
  std::string bytes;
  for (const float number : {NAN, 0.f, 1.f, first, 0.f, 0.f, 1.f, 0.f, 0.f, 0.f, 1.f, 0.5f}) {
    bytes += Raw(number);
  }
  return bytes + "\xff\x7f";
}

std::string Binary(std::uint32_t count, std::string header = "made by hand") {
  header.resize(80, ' ');
  std::string bytes = header + Raw(count);
  for (std::uint32_t i = 0; i < count; ++i) bytes += Record(static_cast<float>(i));
  return bytes;
}

const std::string kFacet =
    "facet normal 0 0 1\n outer loop\n  vertex 0 0 0\n  vertex 1 0 0\n  vertex 0 1 0.1\n endloop\n"
    "endfacet\n";

TEST(StlReader, ReadsBinaryFiles) {
  const MeshData data = MustRead(Binary(2));
  EXPECT_EQ(data.format, MeshFormat::kStl);
  EXPECT_TRUE(data.single_precision);
  EXPECT_THAT(data.vertices, ElementsAre(Vec3d{0, 0, 0}, Vec3d{1, 0, 0}, Vec3d{0, 1, 0.5},
                                         Vec3d{1, 0, 0}, Vec3d{1, 0, 0}, Vec3d{0, 1, 0.5}));
  EXPECT_THAT(data.triangles, ElementsAre(TriangleIndices{0, 1, 2}, TriangleIndices{3, 4, 5}));
}

TEST(StlReader, TakesTheSizeForProofOfABinaryFileWhateverItsHeaderSays) {
  for (const char* header : {"solid cube", "solid x\nfacet normal 0 0 1\n", "ply\nformat ascii 1.0",
                             "OFF", "v 0 0 0\nf 1 1 1\n", "PK\x03\x04", "\xff\xfe\x80", "{"}) {
    EXPECT_EQ(MustRead(Binary(3, header)).triangles.size(), 3u) << header;
  }
}

TEST(StlReader, RefusesABinaryFileOfAnotherSizeThanItsCountAsksFor) {
  for (const std::string header : {"made by hand", "solid cube"}) {
    std::string longer = Binary(2, header) + "x";
    ExpectInvalidAtByte(
        longer, 80,
        "byte 80: as a binary STL, with a count of 2 triangles, the file would have "
        "184 bytes; it has 185");
    std::string cut = Binary(2, header);
    cut.pop_back();
    ExpectInvalidAtByte(
        cut, 80,
        "byte 80: as a binary STL, with a count of 2 triangles, the file would have "
        "184 bytes; it has 183");
  }
  // 84 + 50 * 85899346 is 134 modulo 2^32.
  std::string wraps = Binary(1).replace(80, 4, Raw<std::uint32_t>(85899346));
  ExpectInvalidAtByte(
      wraps, 80,
      "byte 80: as a binary STL, with a count of 85899346 triangles, the file would "
      "have 4294967384 bytes; it has 134");
  std::string most = Binary(1).replace(80, 4, Raw<std::uint32_t>(0xffffffff));
  EXPECT_EQ(MustRefuse(most).byte, 80u);
}

TEST(StlReader, NamesTheByteOfACoordinateThatIsNotFinite) {
  for (const float value : {NAN, std::numeric_limits<float>::infinity()}) {
    std::string file = Binary(2);
    file.replace(84 + 50 + 12 + 16, 4, Raw(value));
    const std::string named = std::isnan(value) ? "'nan'" : "'inf'";
    ExpectInvalidAtByte(file, 162, "byte 162: the coordinate " + named + " is not finite");
  }
}

TEST(StlReader, ReadsAsciiFiles) {
  const MeshData data = MustRead("solid a\n" + kFacet + kFacet + "endsolid a\n");
  EXPECT_EQ(data.format, MeshFormat::kStl);
  EXPECT_FALSE(data.single_precision);
  EXPECT_EQ(data.vertices.size(), 6u);
  EXPECT_EQ(data.vertices[2], (Vec3d{0, 1, 0.1}));
  EXPECT_THAT(data.triangles, ElementsAre(TriangleIndices{0, 1, 2}, TriangleIndices{3, 4, 5}));
}

TEST(StlReader, TakesAsciiFilesAsProgramsWriteThem) {
  for (const std::string& text : std::vector<std::string>{
           "solid\n" + kFacet + "endsolid\n",
           "solid a\n" + kFacet,  // no endsolid
           "solid facet of my solid\n" + kFacet + "endsolid facet of my solid\n",
           "SOLID A\nFACET NORMAL 0 0 1\nOUTER LOOP\nVERTEX 0 0 0\nVERTEX 1 0 0\nVERTEX 0 1 0\n"
           "ENDLOOP\nENDFACET\nENDSOLID A",
           "solid a\nfacet normal nan +inf weird\nouter loop\nvertex 0 0 0\nvertex 1 0 "
           "0\nvertex 0 1 0\nendloop foo\nendfacet bar\nendsolid some blah\n",
           "\xef\xbb\xbfsolid a\r\nfacet normal 0 0 1\r\nouter loop\r\nvertex 0 0 0\r\n"
           "vertex 1 0 0\r\nvertex 0 1 0\r\nendloop\r\nendfacet\r\nendsolid\r\n",
           "solid a\rfacet normal 0 0 1\router loop\rvertex 0 0 0\rvertex 1 0 0\r"
           "vertex 0 1 0\rendloop\rendfacet\rendsolid\r",
       }) {
    EXPECT_EQ(MustRead(text).triangles.size(), 1u) << text;
  }
  std::string one_line = "solid a " + kFacet + "endsolid a solid b " + kFacet + "endsolid b";
  for (char& c : one_line) c = c == '\n' ? ' ' : c;
  EXPECT_EQ(MustRead(one_line).triangles.size(), 2u);
}

TEST(StlReader, TakesAsciiFilesWithTheLibertiesThatProgramsTake) {
  const auto with = [](std::string text, const std::string& piece, const std::string& other) {
    for (std::size_t at = text.find(piece); at != std::string::npos;
         at = text.find(piece, at + other.size())) {
      text.replace(at, piece.size(), other);
    }
    return text;
  };
  const std::string facets = kFacet + kFacet;
  const std::string plain = "solid s\n" + facets + "endsolid s\n";
  for (const std::string& text : {
           with(plain, "endloop", "end loop"),
           with(plain, "endfacet", "end facet"),
           with(plain, "endsolid", "end solid"),
           with(with(with(plain, "endloop", "END LOOP"), "endfacet", "End Facet"), "outer loop",
                "OuterLoop"),
           with(plain, "endsolid s", "endsolids"),
           with(plain, "solid s", "solid_of_mine"),
           with(plain, "solid s\n", "solid s\n color 0.5 0.5 0.5\n"),
           with(plain, " outer", "  color 0.5 0.5 0.5\n outer"),
           with(plain, " endloop", "  COLOR 1 1 1\n endloop"),
           with(plain, "endfacet\n", "endfacet\ncolour 1 1 1\n"),
           with(plain, "  vertex 1", "# remark\n  vertex 1"),
           "# made by hand\n\n" + plain,
           "// made by hand\n" + plain,
           "$ made by hand\n# solid remark\n" + plain,
           with(plain, "normal 0 0 1", ""),
           with(plain, "normal 0 0 1", "0 0 1"),
           with(plain, "normal 0 0 1", "normal"),
           with(plain, "solid s\n", "solid test of facet normal lamp\n"),
           with(plain, "solid s\n", "solid facet normal 0 0 1\n"),
           with(plain, "solid s\n", "solid outer loop vertex endsolid end facet\n"),
           with(plain, "endsolid s\n", "endsolid facet normal 0 0 1\n"),
           plain + std::string(100, '\0'),
           plain + "\x1a",
       }) {
    SCOPED_TRACE(text);
    const MeshData data = MustRead(text);
    EXPECT_EQ(data.format, MeshFormat::kStl);
    EXPECT_EQ(data.triangles.size(), 2u);
  }
}

TEST(StlReader, GoesBySizeWhereABinaryFileDoesNotSayItsCount) {
  const std::string unknown = Binary(2).replace(80, 4, Raw<std::uint32_t>(0));
  EXPECT_EQ(MustRead(unknown).triangles.size(), 2u);
  const Error error = MustRefuse(unknown + "x");
  EXPECT_EQ(error.byte, 80u);
}

TEST(StlReader, PassesNothingButNulBytesBehindTheLastRecord) {
  for (const char* header : {"made by hand", "solid cube"}) {
    for (const std::size_t padding : {1, 92, 100}) {
      EXPECT_EQ(MustRead(Binary(2, header) + std::string(padding, '\0')).triangles.size(), 2u);
    }
    // They could be triangles.
    const Error error = MustRefuse(Binary(2, header) + Record(7));
    EXPECT_EQ(error.byte, 80u);
    EXPECT_EQ(error.message,
              "byte 80: as a binary STL, with a count of 2 triangles, the file would have 184 "
              "bytes; it has 234");
  }
}

TEST(StlReader, MakesOneMeshOfSeveralSolids) {
  EXPECT_EQ(
      MustRead("solid a\n" + kFacet + "endsolid a\nsolid b\n" + kFacet + kFacet + "endsolid b\n")
          .triangles.size(),
      3u);
}

TEST(StlReader, NamesTheLineAndTheCauseInAnAsciiFile) {
  const std::string begin = "solid a\nfacet normal 0 0 1\n outer loop\n";
  const std::string two = "  vertex 0 0 0\n  vertex 1 0 0\n";
  struct Case {
    std::string text;
    std::uint64_t line;
    const char* message;
  };
  for (const Case& c : {
           Case{begin + two + " endloop\nendfacet\n", 6,
                "line 6: 'endloop' where 'vertex' must be"},
           Case{begin + two + two + " endloop\nendfacet\n", 7,
                "line 7: 'vertex' where 'endloop' must be"},
           Case{begin + two + "  vertex 0 1\n", 6, "line 6: a number is missing"},
           Case{begin + two + "  vertex 0 1 nan\n", 6,
                "line 6: the coordinate 'nan' is not finite"},
           Case{begin + two + "  vertex 0 1 1e39\n", 6,
                "line 6: the coordinate '1e39' is beyond 3.4e38"},
           Case{begin + two + "  vertex 0 1 zero\n", 6, "line 6: 'zero' is not a number"},
           Case{begin + two, 6, "line 6: the file ends where 'vertex' must be"},
           Case{"solid a\nfacet normal 0 0 1\nnormal 0 0 1\n outer loop\n" + two, 3,
                "line 3: 'normal' where 'outer loop' must be"},
           Case{"solid a\nfacet normal 0 0 1\n inner loop\n" + two, 3,
                "line 3: 'inner' where 'outer loop' must be"},
           Case{"solid a\n" + kFacet + "face\n", 9,
                "line 9: 'face' does not begin a statement of an STL file"},
           Case{"solid a\n" + kFacet.substr(0, kFacet.size() - 9) + kFacet, 8,
                "line 8: 'facet' where 'endfacet' must be"},
       }) {
    ExpectInvalidAtLine(c.text, c.line, c.message);
  }
}

TEST(StlReader, CallsAFileWithoutTrianglesEmpty) {
  EXPECT_EQ(MustRefuse(Binary(0)).code, ErrorCode::kEmptyMesh);
  EXPECT_EQ(MustRefuse("solid a\nendsolid a\n").code, ErrorCode::kEmptyMesh);
  EXPECT_EQ(MustRefuse("solid").code, ErrorCode::kEmptyMesh);
}

}  // namespace
}  // namespace kdray::core
