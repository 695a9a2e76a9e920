// SPDX-License-Identifier: Apache-2.0
#include "core/io/obj_reader.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

#include "tests/unit/core/io/mesh_texts.h"

namespace kdray::core {
namespace {

using testing::ElementsAre;

const std::string kSquare = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

TEST(ObjReader, ReadsVerticesAndFacesInFileOrder) {
  const MeshData data = MustRead("v 0 0 0.1\nv 1 0 0\nv 0 1 0\nv 1 1 1e30\nf 1 2 3\nf 2 4 3\n");
  EXPECT_EQ(data.format, MeshFormat::kObj);
  EXPECT_THAT(data.vertices,
              ElementsAre(Vec3d{0, 0, 0.1}, Vec3d{1, 0, 0}, Vec3d{0, 1, 0}, Vec3d{1, 1, 1e30}));
  EXPECT_THAT(data.triangles, ElementsAre(TriangleIndices{0, 1, 2}, TriangleIndices{1, 3, 2}));
  EXPECT_FALSE(data.single_precision);
}

TEST(ObjReader, KeepsCoordinatesAsDoubles) {
  EXPECT_EQ(MustRead("v 1.123456789012345 2 3\nf 1 1 1").vertices[0].x, 1.123456789012345);
}

TEST(ObjReader, TakesEveryFormOfACorner) {
  for (const char* face :
       {"f 1 2 3", "f 1/1 2/2 3/3", "f 1//1 2//2 3//3", "f 1/1/1 2/2/2 3/3/3", "f 1// 2// 3//",
        "f 1/ 2/ 3/", "f -4 -3 -2", "f -4/-1 2/5/-9 +3", "fo 1 2 3"}) {
    EXPECT_THAT(MustRead(kSquare + face).triangles, ElementsAre(TriangleIndices{0, 1, 2})) << face;
  }
}

TEST(ObjReader, CountsNegativeNumbersFromTheLastVertexSoFar) {
  const MeshData data = MustRead("v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 5 5 5\nf -3 -2 -1\n");
  EXPECT_THAT(data.triangles, ElementsAre(TriangleIndices{0, 1, 2}, TriangleIndices{1, 2, 3}));
}

TEST(ObjReader, AllowsFacesBeforeTheirVertices) {
  EXPECT_THAT(MustRead("f 1 2 3 4\n" + kSquare).triangles,
              ElementsAre(TriangleIndices{0, 1, 2}, TriangleIndices{0, 2, 3}));
}

TEST(ObjReader, SkipsWAndColoursBehindTheCoordinates) {
  for (const char* extra : {" 1", " 1 0 0", " 0.5 0.5 0.5 1", " nan nan nan", " # remark"}) {
    const std::string text = "v 1 2 3" + std::string(extra) + "\nf 1 1 1\n";
    EXPECT_THAT(MustRead(text).vertices, ElementsAre(Vec3d{1, 2, 3}));
  }
}

TEST(ObjReader, SkipsOtherStatements) {
  const MeshData data = MustRead(
      "# f 9 9 9\nmtllib no such file.mtl\no f 1 2 3\ng An f Three\nusemtl x\ns off\nvt 0 0\n"
      "vn 0 0 1\nvw 1 2\nl 1 2\np 1 2 3\nunheard_of 1 2 3\n" +
      kSquare + "f 1 2 3 # f 2 3 4\n");
  EXPECT_EQ(data.triangles.size(), 1u);
  EXPECT_EQ(data.dropped, 0u);
}

TEST(ObjReader, JoinsNoLineToARemarkAfterAStatement) {
  const MeshData data = MustRead(
      "v 0 0 0 # C:\\\nv 1 0 0\nv 0 1 0 # \\\nv 1 1 0 1 # w \\\nf -4 -3 -2\ns 1 # off\\\n"
      "f -3 -2 -1\nusemtl x # D:\\\nf 1 2 4\n");
  EXPECT_EQ(data.vertices.size(), 4u);
  EXPECT_THAT(data.triangles, ElementsAre(TriangleIndices{0, 1, 2}, TriangleIndices{1, 2, 3},
                                          TriangleIndices{0, 1, 3}));
}

TEST(ObjReader, FindsTheStatementAfterLinesThatAreJoinedToAName) {
  for (const char* joined : {"\\\n", "\\\n\\\n \\\n", "y\\\nz\\\n", "\t \\\ny\\\n\\\n"}) {
    for (const char* face : {"f 1 2 3\n", " f \\\n1 2\\\n3\n", "f\\\n1 2 3\n"}) {
      const std::string text = kSquare + "usemtl x\\\n" + joined + face;
      EXPECT_THAT(MustRead(text).triangles, ElementsAre(TriangleIndices{0, 1, 2})) << text;
    }
  }
}

TEST(ObjReader, SkipsRemarksOfEveryKindAndPaddingAtTheEnd) {
  for (const std::string& text : {
           "# header\n$ distributed at an FTP site\n#\n" + kSquare + "f 1 2 3\n",
           "// made by hand\n" + kSquare + "//faces\nf 1 2 3\n",
           "; remark\n! remark\n* remark\n% remark\n" + kSquare + "f 1 2 3\n",
           "newmtl Blue\nKd 0 0 1\nusemtl Blue\n" + kSquare + "f 1 2 3\n",
           "mtlib a.mtl\n" + kSquare + "f 1 2 3\n",
           "Exported by a program, version 1\n\n" + kSquare + "f 1 2 3\n",
           "\xef\xbb\xbf$ remark\r\n" + kSquare + "f 1 2 3\r\n",
           "\xc3\xa4 remark\n" + kSquare + "f 1 2 3\n",
           "unknown\nf 1/1/1 2/2/2 3/3/3\n" + kSquare,
           kSquare + "f 1 2 3\n\x1a",
           kSquare + "f 1 2 3" + std::string(1, '\x1a') + "\r\n",
           kSquare + "f 1 2 3\n" + std::string(700, '\0'),
       }) {
    SCOPED_TRACE(text);
    const MeshData data = MustRead(text);
    EXPECT_EQ(data.format, MeshFormat::kObj);
    EXPECT_THAT(data.triangles, ElementsAre(TriangleIndices{0, 1, 2}));
  }
}

TEST(ObjReader, JoinsNoStatementToANameThatEndsWithABackslash) {
  for (const std::string end : {"\n", "\r\n"}) {
    EXPECT_EQ(MustRead(kSquare + "usemtl D:\\maps\\" + end + "f 1 2 3\nf 1 3 4\n").triangles.size(),
              2u);
    EXPECT_EQ(MustRead("mtllib C:\\" + end + kSquare + "f 1 2 3\n").vertices.size(), 4u);
    // What goes on with another name is one statement, whatever it says.
    EXPECT_EQ(MustRead(kSquare + "g a \\" + end + "7 b\nf 1 2 3\n").triangles.size(), 1u);
  }
}

TEST(ObjReader, AllowsAnyCoordinateInAVertexThatNoFaceUses) {
  for (const char* number : {"nan", "-NaN", "inf", "-Infinity", "1.#QNAN", "-1.#IND00", "1.#INF",
                             "1e39", "1e400", "-1e400"}) {
    SCOPED_TRACE(number);
    const std::string vertex = "v 0 " + std::string(number) + " 0\n";
    const MeshData data = MustRead(vertex + kSquare + "f 2 3 4\nf 1 2\n");
    EXPECT_EQ(data.triangles.size(), 1u);
    EXPECT_EQ(data.vertices.size(), 5u);
    const Error error = MustRefuse("# remark\n" + kSquare + "f 2 3 5\n" + vertex);
    EXPECT_EQ(error.code, ErrorCode::kInvalidMesh);
    EXPECT_EQ(error.line, 7u);
  }
}

TEST(ObjReader, TakesAnyLineEndContinuationTabsAndAByteOrderMark) {
  for (const std::string end : {"\n", "\r\n", "\r"}) {
    const std::string text = "\xef\xbb\xbfv 0 0 0" + end + "\tv\t1  0 0 " + end + end + "v 0 1 0" +
                             end + "f 1 \\" + end + "2\\" + end + " 3" + end;
    const MeshData data = MustRead(text);
    EXPECT_EQ(data.vertices.size(), 3u);
    EXPECT_THAT(data.triangles, ElementsAre(TriangleIndices{0, 1, 2}));
  }
}

TEST(ObjReader, CutsPolygonsInPlace) {
  const MeshData data = MustRead("v 0 0 0\nv 4 0 0\nv 1 1 0\nv 0 4 0\nf 1 2 3\nf 1 2 3 4\nf 2 3 4");
  ASSERT_EQ(data.triangles.size(), 4u);
  EXPECT_EQ(data.triangles[0], (TriangleIndices{0, 1, 2}));
  EXPECT_EQ(data.triangles[3], (TriangleIndices{1, 2, 3}));
  EXPECT_EQ(data.concave, 1u);
}

TEST(ObjReader, DropsAndCountsFacesWithFewerThanThreeCorners) {
  const MeshData data = MustRead(kSquare + "f\nf 1\nf 1 2\nf 1 2 3\n");
  EXPECT_EQ(data.triangles.size(), 1u);
  EXPECT_EQ(data.dropped, 3u);
}

TEST(ObjReader, NamesTheLineAndTheCause) {
  struct Case {
    std::string text;
    std::uint64_t line;
    const char* message;
  };
  for (const Case& c : {
           Case{kSquare + "f 1 2 5", 5, "line 5: vertex 5 does not exist; the file has 4"},
           Case{kSquare + "f 1 2 0", 5, "line 5: vertex 0 does not exist; OBJ counts from 1"},
           Case{kSquare + "f 1 2 -5", 5,
                "line 5: vertex -5 does not exist; 4 vertices stand before this line"},
           Case{"f -1 1 1\n" + kSquare, 1,
                "line 1: vertex -1 does not exist; 0 vertices stand before this line"},
           Case{kSquare + "f 4294967297 1 1", 5,
                "line 5: vertex 4294967297 does not exist; the file has 4"},
           Case{kSquare + "f 1 2 99999999999999999999", 5,
                "line 5: '99999999999999999999' is not a corner of a face"},
           Case{kSquare + "f 1.0 2 3", 5, "line 5: '1.0' is not a corner of a face"},
           Case{kSquare + "f 0x1 2 3", 5, "line 5: '0x1' is not a corner of a face"},
           Case{kSquare + "f 1/x 2 3", 5, "line 5: '1/x' is not a corner of a face"},
           Case{kSquare + "f 1/1/1/1 2 3", 5, "line 5: '1/1/1/1' is not a corner of a face"},
           Case{kSquare + "f /1 2 3", 5, "line 5: '/1' is not a corner of a face"},
           Case{kSquare + "f 1 \\\n2 \\\n9", 7, "line 7: vertex 9 does not exist; the file has 4"},
           Case{kSquare + "f 1 9", 5, "line 5: vertex 9 does not exist; the file has 4"},
           Case{"v 0 0\nf 1 1 1", 1, "line 1: a number is missing"},
           Case{"v 0 0 0\r\n\r\nv 0 0 x\r\n", 3, "line 3: 'x' is not a number"},
           Case{
               kSquare + "\nv 0 nan 0\nf 1 2 5\n", 6,
               "line 6: y of vertex 5 (counted from 1), which a face uses: the coordinate 'nan' is "
               "not finite"},
           Case{"v 0,0 0,0 1,5\n", 1, "line 1: '0,0' is not a number"},
           Case{
               "f 1 1 1\nv 0 0 -1e39\n", 2,
               "line 2: z of vertex 1 (counted from 1), which a face uses: the coordinate '-1e+39' "
               "is beyond 3.4e38"},
           Case{kSquare + "-1 2 3\n", 5, "line 5: '-1' does not begin a statement of an OBJ file"},
           Case{kSquare + ".5 2 3\n", 5, "line 5: '.5' does not begin a statement of an OBJ file"},
           Case{"v 0 0 0\n1 2 3\n", 2, "line 2: '1' does not begin a statement of an OBJ file"},
           Case{kSquare + std::string("\0f 1 2 3", 8), 5,
                "line 5: '\\x00f' does not begin a statement of an OBJ file"},
       }) {
    ExpectInvalidAtLine(c.text, c.line, c.message);
  }
}

TEST(ObjReader, CallsAFileWithoutTrianglesEmpty) {
  for (const std::string& text :
       {std::string("v 0 0 0\n"), kSquare + "l 1 2\np 1\n", kSquare + "f 1 2\n"}) {
    const Error error = MustRefuse(text);
    EXPECT_EQ(error.code, ErrorCode::kEmptyMesh);
    EXPECT_THAT(error.message, testing::StartsWith("the OBJ file has no face"));
    const bool has_face = text.find('f') != std::string::npos;
    EXPECT_EQ(error.message.find("points have no surface") == std::string::npos, has_face);
  }
}

TEST(ObjReader, EndsANumberWhereACommentTouchesIt) {
  const MeshData data = MustRead("v 0 0 0#a 7\nv 1 0 0# b\nv 0 1 0 #\nf 1 2 3#c 1 2\nf 1//1 2 3##");
  EXPECT_THAT(data.vertices, ElementsAre(Vec3d{}, Vec3d{1, 0, 0}, Vec3d{0, 1, 0}));
  EXPECT_THAT(data.triangles, ElementsAre(TriangleIndices{0, 1, 2}, TriangleIndices{0, 1, 2}));
  ExpectInvalidAtLine("v 0 0 x#1\nf 1 1 1\n", 1, "line 1: 'x#1' is not a number");
  ExpectInvalidAtLine(kSquare + "f 1 2 3/#\nf 1 2 y#\n", 6,
                      "line 6: 'y#' is not a corner of a face");
}

TEST(ObjReader, NamesTheLineOfAPolygonThatIsTooLargeToCut) {
  std::string text = "v 0 0 0\nv 4 0 0\nv 1 1 0\nv 0 4 0\nf 1 2 3\nf";
  for (int i = 0; i < 140000; ++i) text += (i % 2 == 0) ? " 1 2" : " 3 4";
  const Error error = MustRefuse(text);
  EXPECT_EQ(error.code, ErrorCode::kInvalidMesh);
  EXPECT_EQ(error.line, 6u);
}

}  // namespace
}  // namespace kdray::core
