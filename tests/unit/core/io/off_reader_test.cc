// SPDX-License-Identifier: Apache-2.0
#include "core/io/off_reader.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "tests/unit/core/io/mesh_texts.h"

namespace kdray::core {
namespace {

using testing::ElementsAre;

const std::string kSquare = "0 0 0\n1 0 0\n1 1 0\n0 1 0.1\n";

void ExpectSquare(const MeshData& data) {
  EXPECT_EQ(data.format, MeshFormat::kOff);
  EXPECT_FALSE(data.single_precision);
  EXPECT_THAT(data.vertices,
              ElementsAre(Vec3d{0, 0, 0}, Vec3d{1, 0, 0}, Vec3d{1, 1, 0}, Vec3d{0, 1, 0.1}));
  EXPECT_THAT(data.triangles, ElementsAre(TriangleIndices{0, 1, 2}, TriangleIndices{0, 2, 3}));
}

TEST(OffReader, ReadsVerticesAndPolygons) {
  ExpectSquare(MustRead("OFF\n4 1 4\n" + kSquare + "4 0 1 2 3\n"));
}

TEST(OffReader, TakesEveryWayToWriteTheHeader) {
  for (const char* header : {"OFF\n4 1 0\n",
                             "OFF 4 1 0\n",
                             "OFF4 1 0 # counts\n",
                             "OFF\n4 1\n",
                             "4 1 0\n",
                             "# comment\n\n  OFF # keyword\n# comment\n\n4 1 0\n",
                             "COFF\n4 1 0\n",
                             "NOFF\n4 1 0\n",
                             "STOFF\n4 1 0\n",
                             "NCOFF\n4 1 0\n",
                             "CSTOFF\n4 1 0\n",
                             "NSTCOFF\n4 1 0\n",
                             "off\n4 1 0\n",
                             "OFF\n4\n1\n0\n",
                             "OFF\n4 1\n0\n",
                             "OFF 4\n1 0\n",
                             "OFF\n4.0 1.0 0.0\n",
                             "4.00 1. 0\n",
                             "CNOFF\n4 1 0\n",
                             "STCNOFF 4 1 0\n",
                             "\xef\xbb\xbfOFF\n4 1 0\n"}) {
    ExpectSquare(MustRead(header + kSquare + "4 0 1 2 3\n"));
  }
}

TEST(OffReader, EndsANumberWhereACommentTouchesIt) {
  const MeshData data = MustRead("OFF\n3 1 0\n0 0 0#a\n1 0 0# b 5\n0 1 0\n3 0 1 2#c 1\n");
  EXPECT_THAT(data.vertices, ElementsAre(Vec3d{}, Vec3d{1, 0, 0}, Vec3d{0, 1, 0}));
  EXPECT_THAT(data.triangles, ElementsAre(TriangleIndices{0, 1, 2}));
}

TEST(OffReader, SkipsColoursNormalsCommentsAndBlankLines) {
  ExpectSquare(
      MustRead("COFF\n4 1 0\n\n0 0 0 255 0 0 255\n1 0 0 1.0 0.5 # a vertex\n1 1 0\n# between\n\t\n"
               "0 1 0.1 n x y\n 4  0 1 2 3  0.5 0.5 0.5 0.75\n"));
}

TEST(OffReader, TakesAnyLineEnd) {
  for (const std::string end : {"\n", "\r\n", "\r"}) {
    std::string text;
    for (const char c : "OFF\n4 1 0\n" + kSquare + "4 0 1 2 3") {
      text += c == '\n' ? end : std::string(1, c);
    }
    ExpectSquare(MustRead(text));
  }
}

TEST(OffReader, DropsAndCountsFacesWithFewerThanThreeCorners) {
  const MeshData data = MustRead("OFF\n4 4 0\n" + kSquare + "0\n1 0\n2 0 1\n3 0 1 2\n");
  EXPECT_EQ(data.triangles.size(), 1u);
  EXPECT_EQ(data.dropped, 3u);
}

TEST(OffReader, NamesTheLineAndTheCause) {
  struct Case {
    std::string text;
    std::uint64_t line;
    const char* message;
  };
  const std::string header = "OFF\n4 1 0\n";
  for (const Case& c : {
           Case{"OFF\n", 2, "line 2: the OFF file has no counts"},
           Case{"OFF\nfour 1 0\n", 2, "line 2: 'four' is not an integer of 64 bits"},
           Case{"OFF\n4\n", 3, "line 3: an integer is missing"},
           Case{"OFF\n4 -1 0\n", 2, "line 2: '-1' is not a count"},
           Case{
               "OFF\n353535235358 6 0\n0 0 0\n", 2,
               "line 2: 353535235358 vertices and 6 faces do not fit into the 7 bytes that follow"},
           Case{"OFF\n4 4294967295 0\n" + kSquare + "3 0 1 2\n", 2,
                "line 2: 4 vertices and 4294967295 faces do not fit into the 35 bytes that follow"},
           Case{header + "0 0 0\n1 0\n1 1 0\n0 1 0\n4 0 1 2 3\n", 4, "line 4: a number is missing"},
           Case{
               header + "0 0 0\n1 0 nan\n1 1 0\n0 1 0\n4 0 1 2 3\n", 4,
               "line 4: z of vertex 2 (counted from 1), which a face uses: the coordinate 'nan' is "
               "not finite"},
           Case{header + "0 0 0\n1 0 0 # much, much, much, much more\n", 5,
                "line 5: the file ends after 2 of 4 vertices"},
           Case{"OFF\n4 2 0\n" + kSquare + "4 0 1 2 3\n", 8,
                "line 8: the file ends after 1 of 2 faces"},
           Case{header + kSquare + "4 0 1 2\n# no more\n", 7, "line 7: an integer is missing"},
           Case{header + kSquare + "4 0 1 2 4\n", 7,
                "line 7: vertex 4 does not exist; the file has 4, counted from 0"},
           Case{header + kSquare + "4 0 1 2 -1\n", 7,
                "line 7: vertex -1 does not exist; the file has 4, counted from 0"},
           Case{header + kSquare + "4 0 1 2 3.5\n", 7,
                "line 7: '3.5' is not an integer of 64 bits"},
           Case{header + kSquare + "-4 0 1 2 3\n", 7, "line 7: a face cannot have -4 corners"},
           Case{header + kSquare + "2000000000 0 1 2 3\n", 7,
                "line 7: a face of 2000000000 corners does not fit into the 9 bytes that follow"},
       }) {
    ExpectInvalidAtLine(c.text, c.line, c.message);
  }
}

TEST(OffReader, ReadsNumbersThatDoNotKeepToLines) {
  for (const char* text : {
           "OFF\n4 1 5\n0 0 0  1 0 0\n1 1 0  0 1\n0.1\n4 0 1 2 3\n",
           "OFF\n4 1 5\n0 0 0 1\n0 0 1 1\n0 0 1 0.1\n4 0 1 2 3\n",
           "OFF\n4 1 5\n0\n0\n0\n1\n0\n0\n1\n1\n0\n0\n1\n0.1\n4\n0\n1\n2\n3\n",
           "OFF\n4 1 5\n0 0 0\n1 0 0\n1 1 0\n0 1 0.1\n4 0\n1 # colour\n2 3 0.5 0.5 0.5\n",
           "OFF 4 1 5 0 0 0 1 0 0 1 1 0 0 1 0.1 4 0 1 2 3",
           "OFF\n4 1 5 0 0 0 1 0 0\n1 1 0 0 1 0.1 4 0 1 2 3\n",
           "OFF\n4 1 5\n0 0 0 1 0\n0 1 1\n0 0 1\n0.1\n4 0 1 2 3\n",
           "NOFF\n4 1 5\n0 0 0\n0 0 1\n1 0 0\n0 0 1\n1 1 0\n0 0 1\n0 1 0.1\n0 0 1\n4 0 1 2 3\n",
           "CSTOFF\n4 1 5\n0 0 0 1 1 1 1\n.5 .5\n1 0 0 1 1 1 1\n.5 .5 1 1 0 1 1 1 1 .5 .5\n"
           "0 1 0.1 1 1 1 1 .5\n.5\n4 0 1 2 3\n",
           "OFF\n4.0 1.0 0.0\n0 0 0\n1 0 0\n1 1 0\n0 1 0.1\n4.0 0.0 1.0 2.0 3.0\n",
       }) {
    SCOPED_TRACE(text);
    ExpectSquare(MustRead(text));
  }
}

TEST(OffReader, NeverFillsAMissingNumberWithTheNextRows) {
  // Each lacks one number or one line of a good file. Read as words, a vertex would be made of what
  // belongs to faces.
  const std::vector<std::string> good = {"0 0 0",   "1 0 0",   "1 1 0",  "0 1 0.1",
                                         "3 2 1 0", "3 0 2 3", "3 0 1 3"};
  const auto file = [](const std::vector<std::string>& lines) {
    std::string text = "OFF\n4 3 0\n";
    for (const std::string& line : lines) text += line + "\n";
    return text;
  };
  MustRead(file(good));
  for (std::size_t i = 0; i < good.size(); ++i) {
    std::vector<std::string> lines = good;
    lines.erase(lines.begin() + static_cast<std::ptrdiff_t>(i));
    EXPECT_EQ(MustRefuse(file(lines)).code, ErrorCode::kInvalidMesh) << file(lines);
    lines = good;
    lines[i].resize(lines[i].rfind(' '));
    EXPECT_EQ(MustRefuse(file(lines)).code, ErrorCode::kInvalidMesh) << file(lines);
    EXPECT_EQ(MustRefuse(file(lines)).line, i + 3) << file(lines);
  }
}

TEST(OffReader, AllowsAnyCoordinateInAVertexThatNoFaceUses) {
  const MeshData data = MustRead("OFF\n4 1 0\nnan inf 1e400\n0 0 0\n1 0 0\n0 1 0\n3 1 2 3\n");
  EXPECT_EQ(data.vertices.size(), 4u);
  EXPECT_EQ(data.triangles.size(), 1u);
}

TEST(OffReader, CallsAListOfPointsWhatItIs) {
  for (const char* text : {"0 0 0\n1 0 0\n0 1 0\n", "4 1 0\n1 2 3\n4 5 6\n", "1 2 3\n"}) {
    const Error error = MustRefuse(text);
    EXPECT_EQ(error.code, ErrorCode::kUnsupportedMeshFormat) << text;
    EXPECT_THAT(error.message, testing::HasSubstr("a list of points")) << text;
  }
}

TEST(OffReader, RefusesOtherDimensionsAndTheBinaryFormAsNotRead) {
  for (const std::string text : {"4OFF\n3 1 0\n0 0 0 1\n", "nOFF\n3\n3 1 0\n", "STC4nOFF 3 1 0\n",
                                 "4COFF\n3 1 0\n", "nCOFF\n3\n3 1 0\n", "OFF BINARY\n\x01\x02"}) {
    const Error error = MustRefuse(text);
    EXPECT_EQ(error.code, ErrorCode::kUnsupportedMeshFormat);
    EXPECT_EQ(error.line, 1u);
  }
}

TEST(OffReader, CallsAFileWithoutTrianglesEmpty) {
  EXPECT_EQ(MustRefuse("OFF 0 0 0").code, ErrorCode::kEmptyMesh);
  EXPECT_EQ(MustRefuse("OFF\n4 0 0\n" + kSquare).code, ErrorCode::kEmptyMesh);
  EXPECT_EQ(MustRefuse("OFF\n4 1 0\n" + kSquare + "2 0 1\n").code, ErrorCode::kEmptyMesh);
}

}  // namespace
}  // namespace kdray::core
