// SPDX-License-Identifier: Apache-2.0
#include "core/io/mesh_attributes.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "core/base/enumerators.h"
#include "core/io/attribute_sink.h"
#include "tests/support/mesh_files.h"
#include "tests/unit/core/io/mesh_texts.h"

namespace kdray::core {
namespace {

constexpr AttributeKinds kAllKinds = {AttributeKind::kUv, AttributeKind::kShadingNormal,
                                      AttributeKind::kColor, AttributeKind::kGroup,
                                      AttributeKind::kEdges};

MeshAttributes MustReadAttributes(std::string_view text, AttributeKinds kinds = kAllKinds) {
  Result<MeshAttributes> attributes = ReadAttributes(test::Bytes(text), kinds);
  if (attributes.ok()) return *std::move(attributes);
  ADD_FAILURE() << attributes.error().message;
  return {};
}

void ExpectUv(const MeshAttributes& mesh, PrimitiveId id, double u, double v,
              std::array<double, 2> expected) {
  const std::array<double, 2> uv = mesh.Uv(id, u, v);
  EXPECT_NEAR(uv[0], expected[0], 1e-12) << id;
  EXPECT_NEAR(uv[1], expected[1], 1e-12) << id;
}

void ExpectVector(const Vec3d& actual, const Vec3d& expected, double tolerance = 1e-6) {
  EXPECT_NEAR(actual.x, expected.x, tolerance);
  EXPECT_NEAR(actual.y, expected.y, tolerance);
  EXPECT_NEAR(actual.z, expected.z, tolerance);
}

void ExpectNone(const Vec3d& vector) {
  EXPECT_TRUE(std::isnan(vector.x) && std::isnan(vector.y) && std::isnan(vector.z));
}

// Where half of the full intensity of sRGB lies in linear light.
constexpr double kHalf = 0.21404114;

std::vector<std::string> Names(const MeshAttributes& mesh) {
  return {mesh.group_names().begin(), mesh.group_names().end()};
}

const std::string kQuad = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

TEST(MeshAttributes, InterpolatesTheUvOfEachCornerOfAnObjFace) {
  const MeshAttributes mesh = MustReadAttributes(
      kQuad +
      "vt 0 0\nvt 0.5 0\nvt 0.5 0.25\nvt 0 0.25 7\nf 1/1 2/2 3/3 4/4\nf -4/-2 -3/-1 -2/1\n");
  ASSERT_TRUE(mesh.has(AttributeKind::kUv));
  ExpectUv(mesh, 0, 0, 0, {0, 0});
  ExpectUv(mesh, 0, 1, 0, {0.5, 0});
  ExpectUv(mesh, 0, 0, 1, {0.5, 0.25});
  ExpectUv(mesh, 0, 0.25, 0.5, {0.375, 0.125});
  ExpectUv(mesh, 1, 0, 1, {0, 0.25});
  ExpectUv(mesh, 2, 0, 0, {0.5, 0.25});
  ExpectUv(mesh, 2, 1, 0, {0, 0.25});
}

TEST(MeshAttributes, CountNegativeNumbersFromTheLineOfTheFace) {
  const MeshAttributes mesh = MustReadAttributes(
      kQuad + "vt 1 0\nvt 2 0\nvt 3 0\nf 1/-3 2/-2 3/-1\nvt 4 0\nf 1/-1 2/-2 3/-3\n");
  ExpectUv(mesh, 0, 0, 0, {1, 0});
  ExpectUv(mesh, 1, 0, 0, {4, 0});
}

TEST(MeshAttributes, AreMissingWhereTheFileHasNoneOrAWrongNumber) {
  const MeshAttributes mesh = MustReadAttributes(
      kQuad +
      "vt 0 x\nvt 1 1\nvn 0 0 0\nvn 0 0 2\n"
      "f 1 2 3\nf 1/2/2 2/9/9 3/-9/-9\nf 1/1/1 2/2/2 3/2/2\nf 1/2/2 2/2/2 3/2/2\n");
  for (const PrimitiveId id : {0u, 1u}) {
    EXPECT_TRUE(std::isnan(mesh.Uv(id, 0, 0)[0]));
    EXPECT_TRUE(std::isnan(mesh.Uv(id, 0, 0)[1]));
    ExpectNone(mesh.ShadingNormal(id, 0, 0));
  }
  EXPECT_TRUE(std::isnan(mesh.Uv(2, 0, 0)[1]));  // the invalid number
  ExpectNone(mesh.ShadingNormal(2, 0, 0));       // a normal without a direction
  ExpectUv(mesh, 3, 0.2, 0.3, {1, 1});
  ExpectVector(mesh.ShadingNormal(3, 0.2, 0.3), {0, 0, 1});
}

TEST(MeshAttributes, NormalsHaveUnitLengthAlsoBetweenCornersAndAreNotTurned) {
  const MeshAttributes mesh = MustReadAttributes(
      kQuad + "vn 0 0 -5\nvn 3 0 0\nvn 1e-30 0 0\nf 1//1 2//2 3//2\nf 1//3 2//3 3//3\n");
  ExpectVector(mesh.ShadingNormal(0, 0, 0), {0, 0, -1});
  const double half = std::sqrt(0.5);
  ExpectVector(mesh.ShadingNormal(0, 0.5, 0), {half, 0, -half});
  EXPECT_NEAR(Length(mesh.ShadingNormal(0, 0.3, 0.1)), 1, 1e-15);
  ExpectVector(mesh.ShadingNormal(1, 0, 0), {1, 0, 0});
}

TEST(MeshAttributes, NormalsThatCancelAreNone) {
  const MeshAttributes mesh = MustReadAttributes(kQuad + "vn 0 0 1\nvn 0 0 -1\nf 1//1 2//2 3//1\n");
  ExpectNone(mesh.ShadingNormal(0, 0.5, 0));
}

TEST(MeshAttributes, ReadColorsOfObjVerticesAsFractionsOrBytes) {
  const std::string face = "f 1 2 3\n";
  const MeshAttributes fractions =
      MustReadAttributes("v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0.5 0.5 0.5\n" + face);
  ExpectVector(fractions.Color(0, 0, 0), {1, 0, 0});
  ExpectVector(fractions.Color(0, 0, 1), {kHalf, kHalf, kHalf});
  ExpectVector(fractions.Color(0, 0.5, 0), {kHalf, kHalf, 0});  // interpolated as it is encoded
  const MeshAttributes bytes =
      MustReadAttributes("v 0 0 0 255 0 0\nv 1 0 0 0 255 0\nv 0 1 0 127.5 127.5 127.5\n" + face);
  ExpectVector(bytes.Color(0, 0, 1), {kHalf, kHalf, kHalf});
  const MeshAttributes some =
      MustReadAttributes("v 0 0 0 1 0 0\nv 1 0 0\nv 0 1 0 1\nv 0 0 1 1 0 0\nf 1 1 4\n" + face);
  ExpectVector(some.Color(0, 0.3, 0.3), {1, 0, 0});
  ExpectNone(some.Color(1, 0.3, 0.3));
  EXPECT_FALSE(
      MustReadAttributes("v 0 0 0 1\nv 1 0 0 1\nv 0 1 0 1\n" + face).has(AttributeKind::kColor));
}

TEST(MeshAttributes, GroupsOfObjAreObjectsElseGroupsElseMaterials) {
  const std::string three = kQuad + "f 1 2 3\n";
  const auto groups_of = [](const MeshAttributes& mesh, PrimitiveId triangles) {
    std::vector<std::int32_t> groups;
    for (PrimitiveId id = 0; id < triangles; ++id) groups.push_back(mesh.Group(id));
    return groups;
  };
  using Numbers = std::vector<std::int32_t>;
  using Texts = std::vector<std::string>;
  const MeshAttributes objects = MustReadAttributes(
      three + "g a\nusemtl m\no Lamp shade \nf 1 2 3 4\no B\nf 1 2 3\no Lamp shade\nf 1 2 3\n");
  EXPECT_EQ(Names(objects), (Texts{"Lamp shade", "B"}));
  EXPECT_EQ(groups_of(objects, 5), (Numbers{-1, 0, 0, 1, 0}));
  const MeshAttributes groups =
      MustReadAttributes(three + "usemtl m\ng a b\nf 1 2 3\ng\nf 1 2 3\ng empty\n");
  EXPECT_EQ(Names(groups), (Texts{"a b", "default"}));
  EXPECT_EQ(groups_of(groups, 3), (Numbers{-1, 0, 1}));
  const MeshAttributes materials =
      MustReadAttributes(three + "usemtl a\\\nf 1 2 3\nusemtl b\nf 1 2\nusemtl c\nf 1 2 3\n");
  EXPECT_EQ(Names(materials), (Texts{"a", "c"}));
  EXPECT_EQ(groups_of(materials, 3), (Numbers{-1, 0, 1}));
  EXPECT_FALSE(MustReadAttributes(three).has(AttributeKind::kGroup));
}

TEST(MeshAttributes, CutsNamesBetweenCharactersAndReplacesWhatIsNotUtf8) {
  EXPECT_EQ(ShownGroupName("plain"), "plain");
  EXPECT_EQ(ShownGroupName(std::string(200, 'x')), std::string(128, 'x'));
  EXPECT_EQ(ShownGroupName(std::string(127, 'x') + "\xc3\xa9"), std::string(127, 'x'));
  EXPECT_EQ(ShownGroupName(std::string(126, 'x') + "\xc3\xa9"), std::string(126, 'x') + "\xc3\xa9");
  EXPECT_EQ(ShownGroupName("a\xe9z"), "a\xef\xbf\xbdz");                   // Latin-1
  EXPECT_EQ(ShownGroupName("\xc0\x80"), "\xef\xbf\xbd\xef\xbf\xbd");       // overlong
  EXPECT_EQ(ShownGroupName("\xed\xa0\x80").substr(0, 3), "\xef\xbf\xbd");  // a surrogate
  EXPECT_EQ(ShownGroupName("\xf4\x90\x80\x80").substr(0, 3), "\xef\xbf\xbd");
  EXPECT_EQ(ShownGroupName("\xe2\x82"), "\xef\xbf\xbd\xef\xbf\xbd");  // cut off
  EXPECT_EQ(ShownGroupName("\xf0\x9f\x99\x82"), "\xf0\x9f\x99\x82");
}

TEST(MeshAttributes, HaveNoGroupBeyondTheLastThatIsCounted) {
  std::string text = kQuad;
  for (int i = 0; i < 4100; ++i) text += "g " + std::to_string(i) + "\nf 1 2 3\n";
  text += "g 7\nf 1 2 3\n";
  const MeshAttributes mesh = MustReadAttributes(text);
  EXPECT_EQ(mesh.group_names().size(), 4096u);
  EXPECT_EQ(mesh.Group(4095), 4095);
  EXPECT_EQ(mesh.Group(4096), -1);
  EXPECT_EQ(mesh.Group(4100), 7);
}

TEST(MeshAttributes, EdgesAreTheSidesOfFacesAndNotDiagonals) {
  // A convex pentagon is fanned; only its outline remains.
  const MeshAttributes fan =
      MustReadAttributes("v 0 0 0\nv 2 0 0\nv 3 1 0\nv 1 2 0\nv -1 1 0\nf 1 2 3\nf 1 2 3 4 5\n");
  EXPECT_EQ(fan.Edges(0), 7);
  EXPECT_EQ(fan.Edges(1), 0b011);
  EXPECT_EQ(fan.Edges(2), 0b010);
  EXPECT_EQ(fan.Edges(3), 0b110);
  EXPECT_FALSE(MustReadAttributes(kQuad + "f 1 2 3\nf 1 3 4\n").has(AttributeKind::kEdges));
}

TEST(MeshAttributes, EveryEdgeOfAConcavePolygonIsThatOfOneTriangle) {
  // A comb: its triangles come from ears in any order.
  std::string text;
  const int teeth = 6;
  int corners = 0;
  std::string face = "f";
  for (int i = 0; i < teeth; ++i) {
    text += "v " + std::to_string(2 * i) + " 0 0\nv " + std::to_string(2 * i + 1) + " 5 0\n";
    corners += 2;
  }
  text += "v " + std::to_string(2 * teeth) + " 0 0\nv " + std::to_string(2 * teeth) +
          " -1 0\nv 0 -1 0\n";
  corners += 3;
  for (int i = corners; i >= 1; --i) face += " " + std::to_string(i);
  const std::string file = text + face + "\n";
  const MeshData data = MustRead(file);
  const MeshAttributes mesh = MustReadAttributes(file);
  ASSERT_EQ(data.concave, 1u);
  ASSERT_EQ(data.triangles.size(), static_cast<std::size_t>(corners - 2));
  std::multiset<std::pair<std::uint32_t, std::uint32_t>> edges;
  for (PrimitiveId id = 0; id < data.triangles.size(); ++id) {
    for (unsigned k = 0; k < 3; ++k) {
      if ((mesh.Edges(id) >> k & 1u) == 0) continue;
      edges.emplace(data.triangles[id][k], data.triangles[id][(k + 1) % 3]);
    }
  }
  const auto n = static_cast<std::uint32_t>(corners);
  std::multiset<std::pair<std::uint32_t, std::uint32_t>> outline;
  for (std::uint32_t i = 0; i < n; ++i) outline.emplace((i + 1) % n, i);
  EXPECT_EQ(edges, outline);
}

TEST(MeshAttributes, ReadPlyVerticesInEveryFormAndOrder) {
  const std::string header =
      "element vertex 3\nproperty uchar red\nproperty float nx\nproperty float x\nproperty float "
      "y\n"
      "property float z\nproperty float ny\nproperty float nz\nproperty double s\nproperty double "
      "t\n"
      "property uchar green\nproperty uchar blue\nelement face 1\n"
      "property list uchar int vertex_indices\nend_header\n";
  const std::string ascii = "ply\nformat ascii 1.0\n" + header +
                            "255 0 0 0 0 0 2 0 0 0 0\n0 1 1 0 0 0 0 1 0 255 0\n"
                            "0 0 0 1 0 1 0 0.25 0.75 0 51\n3 0 1 2\n";
  struct Row {
    std::array<std::uint8_t, 3> rgb;
    std::array<float, 3> n, p;
    std::array<double, 2> st;
  };
  for (const std::endian order : {std::endian::little, std::endian::big}) {
    std::string binary = std::string("ply\nformat binary_") +
                         (order == std::endian::little ? "little" : "big") + "_endian 1.0\n" +
                         header;
    for (const Row& row : {Row{{255, 0, 0}, {0, 0, 2}, {0, 0, 0}, {0, 0}},
                           Row{{0, 255, 0}, {1, 0, 0}, {1, 0, 0}, {1, 0}},
                           Row{{0, 0, 51}, {0, 1, 0}, {0, 1, 0}, {0.25, 0.75}}}) {
      binary += Raw(row.rgb[0]) + Raw(row.n[0], order);
      for (const float x : row.p) binary += Raw(x, order);
      binary += Raw(row.n[1], order) + Raw(row.n[2], order);
      for (const double x : row.st) binary += Raw(x, order);
      binary += Raw(row.rgb[1]) + Raw(row.rgb[2]);
    }
    binary += Raw<std::uint8_t>(3);
    for (const std::int32_t i : {0, 1, 2}) binary += Raw(i, order);
    for (const std::string& text : {ascii, binary}) {
      const MeshAttributes mesh = MustReadAttributes(text);
      ExpectUv(mesh, 0, 0, 1, {0.25, 0.75});
      ExpectUv(mesh, 0, 0.5, 0, {0.5, 0});
      ExpectVector(mesh.ShadingNormal(0, 0, 0), {0, 0, 1});
      ExpectVector(mesh.ShadingNormal(0, 0, 1), {0, 1, 0});
      ExpectVector(mesh.Color(0, 0, 0), {1, 0, 0});
      ExpectVector(mesh.Color(0, 1, 0), {0, 1, 0});
      ExpectVector(mesh.Color(0, 0, 1), {0, 0, 0.033104766});  // 0.2 of sRGB
    }
  }
}

TEST(MeshAttributes, ReadColorsOfPlyFacesBeforeAndAfterTheirCorners) {
  const std::string vertices =
      "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
      "property float z\n";
  const std::string rows = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n";
  const MeshAttributes after = MustReadAttributes(
      vertices +
      "element face 2\nproperty list uchar int vertex_indices\nproperty uchar red\n"
      "property uchar green\nproperty uchar blue\nend_header\n" +
      rows + "4 0 1 2 3 255 0 0\n3 0 1 2 0 255 0\n");
  ExpectVector(after.Color(0, 0.2, 0.2), {1, 0, 0});
  ExpectVector(after.Color(1, 0.2, 0.2), {1, 0, 0});
  ExpectVector(after.Color(2, 0.2, 0.2), {0, 1, 0});
  EXPECT_EQ(after.Edges(0), 0b011);
  EXPECT_EQ(after.Edges(1), 0b110);
  const MeshAttributes before = MustReadAttributes(
      vertices +
      "element face 2\nproperty float red\nproperty float green\nproperty float blue\n"
      "property list uchar int vertex_indices\nend_header\n" +
      rows + "0 0 1 3 0 1 2\n0 1 0 3 0 1 2\n");
  ExpectVector(before.Color(0, 0.2, 0.2), {0, 0, 1});
  ExpectVector(before.Color(1, 0.2, 0.2), {0, 1, 0});
}

TEST(MeshAttributes, OfAFileThatIsReadTwiceAreThoseOfItsOnlyReading) {
  // The last vertex is no float, so all are read again as doubles; and rows are on any lines.
  const MeshAttributes mesh = MustReadAttributes(
      "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
      "property float z\nproperty float s\nproperty float t\nelement face 1\n"
      "property list uchar int vertex_indices\nend_header\n"
      "0 0 0 0.5 0 1 0 0 1\n0 0 1 0.1000000000001 0 1\n3 0 1 2\n");
  ExpectUv(mesh, 0, 0, 0, {0.5, 0});
  ExpectUv(mesh, 0, 0, 1, {0, 1});
}

TEST(MeshAttributes, ReadColorsOfOffVerticesAndFaces) {
  const std::string faces = "3 0 1 2\n";
  for (const std::string& text :
       {"COFF\n3 1 0\n0 0 0 255 0 0 255\n1 0 0 0 255 0 255\n0 1 0 0 0 255 255\n" + faces,
        "COFF\n3 1 0\n0 0 0 1 0 0\n1 0 0 0 1 0\n0 1 0 0 0 1\n" + faces,
        "CNOFF\n3 1 0\n0 0 0 9 9 9 1 0 0 1\n1 0 0 9 9 9 0 1 0 1\n0 1 0 9 9 9 0 0 1 1\n" + faces,
        "COFF 3 1 0 0 0 0 1 0 0 1 1 0 0 0 1 0 1\n0 1 0 0 0 1 1\n" + faces}) {
    const MeshAttributes mesh = MustReadAttributes(text);
    ExpectVector(mesh.Color(0, 0, 0), {1, 0, 0});
    ExpectVector(mesh.Color(0, 1, 0), {0, 1, 0});
    ExpectVector(mesh.Color(0, 0, 1), {0, 0, 1});
  }
  const MeshAttributes by_face = MustReadAttributes(
      "OFF\n4 3 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3 255 0 0\n3 0 1 2 7\n3 0 1 2 0 0 255 10\n");
  ExpectVector(by_face.Color(1, 0.1, 0.1), {1, 0, 0});
  ExpectNone(by_face.Color(2, 0.1, 0.1));
  ExpectVector(by_face.Color(3, 0.1, 0.1), {0, 0, 1});
  EXPECT_EQ(by_face.Edges(1), 0b110);
}

TEST(MeshAttributes, EverySolidOfAnAsciiStlIsAGroup) {
  const std::string facet =
      "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\n"
      "endfacet\n";
  const MeshAttributes mesh = MustReadAttributes(
      "solid first part\n" + facet + facet + "endsolid first part\nsolid empty\nendsolid\n" +
      facet + "solid\n" + facet + "endsolid\nsolid\n" + facet + "endsolid\n");
  EXPECT_EQ(Names(mesh), (std::vector<std::string>{"first part", "", ""}));
  std::vector<std::int32_t> groups;
  for (PrimitiveId id = 0; id < 5; ++id) groups.push_back(mesh.Group(id));
  EXPECT_EQ(groups, (std::vector<std::int32_t>{0, 0, -1, 1, 2}));
}

TEST(MeshAttributes, StoreNothingThatTheFileDoesNotHaveOrNobodyNamed) {
  const std::string plain = kQuad + "f 1 2 3\nf 1 3 4\n";
  EXPECT_EQ(MustReadAttributes(plain).bytes(), MeshAttributes().bytes());
  const std::string full = kQuad + "vt 0 0\nvn 0 0 1\no a\nf 1/1/1 2/1/1 3/1/1 4/1/1\n";
  const std::uint64_t names = MustReadAttributes(full, {}).bytes();
  for (const AttributeKind kind : kAll<AttributeKind>) {
    const MeshAttributes one = MustReadAttributes(full, {kind});
    EXPECT_EQ(one.kinds(), AttributeKinds{kind});
    for (const AttributeKind other : kAll<AttributeKind>) {
      EXPECT_EQ(one.has(other), other == kind && kind != AttributeKind::kColor) << Name(other);
    }
    EXPECT_EQ(one.bytes() == names, kind == AttributeKind::kColor) << Name(kind);
  }
}

TEST(MeshAttributes, AreWithinTheMemoryThatTheCountsSay) {
  const std::string file = kQuad + "vt 0 0\nvn 0 0 1\no a\nf 1/1/1 2/1/1 3/1/1 4/1/1\n";
  std::uint64_t told = 0;
  MeshReadOptions options;
  options.on_counts = [&](const MeshCounts& counts) -> Status {
    told = counts.other_bytes;
    return {};
  };
  const auto mesh = ReadAttributes(test::Bytes(file), kAllKinds, options);
  ASSERT_TRUE(mesh.ok());
  EXPECT_LE(mesh->bytes(), told + sizeof(MeshAttributes));
}

TEST(MeshAttributes, LeaveTheTrianglesAsTheyAreWithoutThem) {
  KDRAY_NEED_MESHES();
  for (const char* name : {"cow.obj", "spot_quads_uv.obj", "star_32gon.obj", "wallhole_crlf.obj",
                           "suzanne_quads_st.ply", "ply_tristrips.ply", "fandisk_quads.off",
                           "two_solids_ascii.stl", "cubevc.glb", "mode5_strips.gltf"}) {
    SCOPED_TRACE(name);
    std::filesystem::path path = *test::MeshFolder() / name;
    if (!exists(path)) path = *test::MeshFolder() / "bad" / name;
    const std::vector<std::byte> bytes = test::ReadFileBytes(path);
    const Result<MeshData> plain = ReadMesh(bytes);
    ASSERT_TRUE(plain.ok());
    AttributeSink sink(kAllKinds);
    MeshReadOptions options;
    options.attributes = &sink;
    const Result<MeshData> with = ReadMesh(bytes, options);
    ASSERT_TRUE(with.ok());
    EXPECT_EQ(plain->triangles, with->triangles);
    EXPECT_EQ(plain->vertices, with->vertices);
    EXPECT_EQ(plain->dropped, with->dropped);
  }
}

}  // namespace
}  // namespace kdray::core
