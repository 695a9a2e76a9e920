// SPDX-License-Identifier: Apache-2.0
#include "core/io/gltf_reader.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <filesystem>
#include <string>
#include <vector>

#include "core/io/gltf_document.h"
#include "core/io/mesh_attributes.h"
#include "tests/support/cancel_probe.h"
#include "tests/support/gltf_mesh.h"
#include "tests/support/mesh_files.h"
#include "tests/unit/core/io/gltf_texts.h"

namespace kdray::core {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

// Positions of the corners of all triangles.
std::vector<Vec3d> Corners(const MeshData& data) {
  std::vector<Vec3d> corners;
  for (const TriangleIndices& triangle : data.triangles) {
    for (const std::uint32_t vertex : triangle) corners.push_back(data.vertices[vertex]);
  }
  return corners;
}

void ExpectNear(const Vec3d& a, const Vec3d& b, double tolerance) {
  EXPECT_NEAR(a.x, b.x, tolerance);
  EXPECT_NEAR(a.y, b.y, tolerance);
  EXPECT_NEAR(a.z, b.z, tolerance);
}

void ExpectCorners(const std::string& text, const std::vector<Vec3d>& expected) {
  const std::vector<Vec3d> corners = Corners(MustRead(text));
  ASSERT_EQ(corners.size(), expected.size()) << text;
  for (std::size_t i = 0; i < corners.size(); ++i) ExpectNear(corners[i], expected[i], 1e-14);
}

const std::vector<Vec3d> kTriangle = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};

TEST(GltfReader, ReadsTheSameTrianglesFromGlbAndText) {
  ExpectCorners(GltfParts().Text(), kTriangle);
  ExpectCorners(GltfParts().Glb(), kTriangle);
  EXPECT_EQ(MustRead(GltfParts().Text()).format, MeshFormat::kGltf);
  EXPECT_EQ(MustRead(GltfParts().Glb()).format, MeshFormat::kGlb);
  EXPECT_EQ(MustRead(GltfParts().Glb()).vertices.size(), 4u);
  EXPECT_TRUE(MustRead(GltfParts().Glb()).single_precision);
}

TEST(GltfReader, AgreesWithAnIndependentReaderOnRealFiles) {
  KDRAY_NEED_MESHES();
  int compared = 0;
  for (const auto& entry : std::filesystem::directory_iterator(*test::MeshFolder())) {
    const std::string ending = entry.path().extension().string();
    if (ending != ".glb" && ending != ".gltf") continue;
    SCOPED_TRACE(entry.path().filename().string());
    const std::vector<std::byte> bytes = test::ReadFileBytes(entry.path());
    MeshData expected;
    try {
      expected = test::ReadGltf(bytes);
    } catch (const std::exception&) {
      continue;  // strips, which that reader does not know
    }
    ++compared;
    const Result<MeshData> mesh = ReadMesh(bytes);
    ASSERT_TRUE(mesh.ok()) << mesh.error().message;
    // That reader keeps the order of corners where a node mirrors; none of these files does.
    EXPECT_EQ(mesh->triangles, expected.triangles);
    EXPECT_EQ(mesh->vertices, expected.vertices);
  }
  EXPECT_GE(compared, 15);
}

TEST(GltfReader, ReadsEveryTypeOfIndexAndNone) {
  GltfParts parts;
  for (const auto& [type, raw] : {std::pair{"5121", RawList<std::uint8_t>({0, 1, 2})},
                                  {"5123", RawList<std::uint16_t>({0, 1, 2})},
                                  {"5125", RawList<std::uint32_t>({0, 1, 2})}}) {
    parts.binary = RawList<float>({0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0}) + raw;
    parts.accessors = std::string(R"([{"bufferView": 0, "componentType": 5126, "count": 4,
                      "type": "VEC3"}, {"bufferView": 1, "componentType": )") +
                      type + R"(, "count": 3, "type": "SCALAR"}])";
    parts.views = R"([{"buffer": 0, "byteLength": 48},
                      {"buffer": 0, "byteOffset": 48, "byteLength": )" +
                  std::to_string(raw.size()) + "}]";
    ExpectCorners(parts.Glb(), kTriangle);
  }
  parts.meshes = R"([{"primitives": [{"attributes": {"POSITION": 0}}]}])";
  ExpectCorners(parts.Glb(), kTriangle);
  EXPECT_EQ(MustRead(parts.Glb()).dropped, 1u);  // the fourth vertex begins another
}

TEST(GltfReader, ReadsStripsAndFansAndSkipsPointsAndLines) {
  GltfParts parts;
  const auto mode = [&](int number) {
    parts.meshes = R"([{"primitives": [{"attributes": {"POSITION": 0}, "mode": )" +
                   std::to_string(number) + "}]}]";
    return parts.Glb();
  };
  const Vec3d a{0, 0, 0}, b{1, 0, 0}, c{0, 1, 0}, d{1, 1, 0};
  ExpectCorners(mode(5), {a, b, c, b, d, c});
  ExpectCorners(mode(6), {a, b, c, a, c, d});
  for (const int other : {0, 1, 2, 3}) {
    EXPECT_EQ(MustRefuse(mode(other)).code, ErrorCode::kEmptyMesh) << other;
  }
  EXPECT_THAT(MustRefuse(mode(7)).message, HasSubstr("/meshes/0/primitives/0: has the mode 7"));
}

TEST(GltfReader, ReadsViewsWithAStrideAndOffsets) {
  GltfParts parts;
  parts.binary = "skip" + RawList<float>({9, 0, 0, 0, 9, 1, 0, 0, 9, 0, 1, 0});
  parts.accessors = R"([{"bufferView": 0, "byteOffset": 4, "componentType": 5126, "count": 3,
                         "type": "VEC3"}])";
  parts.views = R"([{"buffer": 0, "byteOffset": 4, "byteLength": 48, "byteStride": 16}])";
  parts.meshes = R"([{"primitives": [{"attributes": {"POSITION": 0}}]}])";
  ExpectCorners(parts.Glb(), kTriangle);
}

TEST(GltfReader, ReplacesSparseValues) {
  GltfParts parts;
  parts.binary += RawList<std::uint8_t>({2, 0, 0, 0}) + RawList<float>({0, 5, 0});
  parts.views = R"([{"buffer": 0, "byteLength": 48}, {"buffer": 0, "byteOffset": 48,
    "byteLength": 6}, {"buffer": 0, "byteOffset": 54, "byteLength": 4},
    {"buffer": 0, "byteOffset": 58, "byteLength": 12}])";
  const std::string sparse =
      R"("componentType": 5126, "count": 4, "type": "VEC3", "sparse": {"count": 1,
         "indices": {"bufferView": 2, "componentType": 5121}, "values": {"bufferView": 3}}})";
  const std::string indices =
      R"({"bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR"}])";
  parts.accessors = R"([{"bufferView": 0, )" + sparse + ", " + indices;
  ExpectCorners(parts.Glb(), {{0, 0, 0}, {1, 0, 0}, {0, 5, 0}});
  parts.accessors = "[{" + sparse + ", " + indices;  // the others are zero
  ExpectCorners(parts.Glb(), {{0, 0, 0}, {0, 0, 0}, {0, 5, 0}});
  parts.binary[54] = 4;
  EXPECT_EQ(MustRefuse(parts.Glb()).message,
            "/accessors/0/sparse/indices: names element 4; the accessor has 4");
}

TEST(GltfReader, AppliesTransformsOfNodesInDoubleParentsLast) {
  GltfParts parts;
  // First a quarter turn around z, then a scale, then a translation; then the parent's.
  parts.nodes = R"([{"children": [1], "matrix": [1,0,0,0, 0,1,0,0, 0,0,1,0, 0.1,0,1e8,1]},
    {"mesh": 0, "rotation": [0, 0, 0.7071067811865476, 0.7071067811865476], "scale": [2, 3, 1],
     "translation": [10, 0, 0]}])";
  ExpectCorners(parts.Text(), {{10.1, 0, 1e8}, {10.1, 2, 1e8}, {7.1, 0, 1e8}});
}

TEST(GltfReader, ExchangesTwoCornersWhereANodeMirrors) {
  GltfParts parts;
  parts.nodes = R"([{"mesh": 0, "scale": [-1, 1, 1]}])";
  ExpectCorners(parts.Text(), {{0, 0, 0}, {0, 1, 0}, {-1, 0, 0}});
  parts.nodes = R"([{"mesh": 0, "scale": [-1, -1, 1]}])";
  ExpectCorners(parts.Text(), {{0, 0, 0}, {-1, 0, 0}, {0, -1, 0}});
}

TEST(GltfReader, TakesNodesDepthFirstAndEachMeshOnceForEachNode) {
  GltfParts parts;
  parts.nodes = R"([{"children": [2, 3], "mesh": 0}, {"mesh": 0, "translation": [4, 0, 0]},
    {"mesh": 0, "translation": [1, 0, 0], "children": [4]}, {"mesh": 0, "translation": [3, 0, 0]},
    {"mesh": 0, "translation": [1, 0, 0]}])";
  parts.scenes = R"("scenes": [{"nodes": [0, 1]}])";
  const MeshData mesh = MustRead(parts.Text());
  std::vector<double> firsts;
  for (const TriangleIndices& t : mesh.triangles) firsts.push_back(mesh.vertices[t[0]].x);
  EXPECT_THAT(firsts, ElementsAre(0, 1, 2, 3, 4));
  EXPECT_EQ(mesh.vertices.size(), 20u);
}

TEST(GltfReader, ChoosesTheSceneThatIsNamedElseTheFirstElseAllRoots) {
  GltfParts parts;
  parts.nodes = R"([{"mesh": 0}, {"mesh": 0, "translation": [1, 0, 0], "children": [2]},
                    {"mesh": 0, "translation": [1, 0, 0]}])";
  const auto first_x = [&](const std::string& scenes) {
    parts.scenes = scenes;
    std::vector<double> firsts;
    const MeshData mesh = MustRead(parts.Text());
    for (const TriangleIndices& t : mesh.triangles) firsts.push_back(mesh.vertices[t[0]].x);
    return firsts;
  };
  EXPECT_THAT(first_x(R"("scene": 1, "scenes": [{"nodes": [1]}, {"nodes": [0]}])"), ElementsAre(0));
  EXPECT_THAT(first_x(R"("scenes": [{"nodes": [1]}, {"nodes": [0]}])"), ElementsAre(1, 2));
  EXPECT_THAT(first_x(R"("extras": 0)"), ElementsAre(0, 1, 2));
}

TEST(GltfReader, ReadsQuantizedPositionsWhereTheExtensionIsNamed) {
  GltfParts parts;
  parts.binary = RawList<std::int16_t>({0, 0, 0, 0, 32767, 0, 0, 0, 0, -32768, 0, 0});
  parts.views = R"([{"buffer": 0, "byteLength": 24, "byteStride": 8}])";
  parts.meshes = R"([{"primitives": [{"attributes": {"POSITION": 0}}]}])";
  const auto accessor = [](const std::string& normalized) {
    return R"([{"bufferView": 0, "componentType": 5122, "count": 3, "type": "VEC3", "normalized": )" +
           normalized + "}]";
  };
  parts.accessors = accessor("true");
  EXPECT_THAT(MustRefuse(parts.Glb()).message,
              HasSubstr("/accessors/0: has components of type SHORT, normalized"));
  for (const char* list : {"extensionsUsed", "extensionsRequired"}) {
    parts.more = std::string("\"") + list + R"(": ["KHR_mesh_quantization"], )";
    parts.accessors = accessor("true");
    ExpectCorners(parts.Glb(), {{0, 0, 0}, {1, 0, 0}, {0, -1, 0}});
    parts.accessors = accessor("false");
    ExpectCorners(parts.Glb(), {{0, 0, 0}, {32767, 0, 0}, {0, -32768, 0}});
  }
}

TEST(GltfReader, NamesARequiredExtensionThatItDoesNotRead) {
  GltfParts parts;
  parts.more = R"("extensionsRequired": ["KHR_mesh_quantization", "KHR_draco_mesh_compression"], )";
  const Error error = MustRefuse(parts.Text());
  EXPECT_EQ(error.code, ErrorCode::kInvalidMesh);
  EXPECT_THAT(error.message, HasSubstr("/extensionsRequired/1"));
  EXPECT_THAT(error.message, HasSubstr("'KHR_draco_mesh_compression'"));
}

TEST(GltfReader, SaysWhereABrokenFileIsWrong) {
  struct Case {
    std::string file;
    std::string message;  // a part of it
  };
  const auto with = [](const auto& change) {
    GltfParts parts;
    change(parts);
    return parts.Text();
  };
  const auto nodes = [&](const char* text) { return with([&](GltfParts& p) { p.nodes = text; }); };
  const auto meshes = [&](const char* text) {
    return with([&](GltfParts& p) { p.meshes = text; });
  };
  const auto accessors = [&](const std::string& first, const std::string& second) {
    return with([&](GltfParts& p) { p.accessors = "[{" + first + "}, {" + second + "}]"; });
  };
  const auto views = [&](const char* text) { return with([&](GltfParts& p) { p.views = text; }); };
  const std::string position =
      R"("bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3")";
  const std::string index =
      R"("bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR")";
  for (const Case& c : std::vector<Case>{
           {with([](GltfParts& p) { p.scenes = R"("scene": 2, "scenes": [{}])"; }),
            "/scene: scene 2 does not exist; the file has 1"},
           {with([](GltfParts& p) { p.scenes = R"("scene": "a", "scenes": [{}])"; }),
            "/scene: is not an integer from 0 on"},
           {with([](GltfParts& p) { p.scenes = R"("scenes": [{"nodes": [7]}])"; }),
            "/scenes: node 7 does not exist; the file has 1"},
           {nodes(R"([{"mesh": 3}])"), "/nodes/0: mesh 3 does not exist; the file has 1"},
           {nodes(R"([{"children": [9]}])"), "/nodes/0/children: node 9 does not exist"},
           {nodes(R"([{"children": [0]}])"), "/nodes/0: the scene reaches this node twice"},
           {nodes(R"([{"children": [1]}, {"children": [0]}])"),
            "/nodes/0: the scene reaches this node twice"},
           {nodes(R"([{"children": [1, 1]}, {"mesh": 0}])"),
            "/nodes/1: the scene reaches this node twice"},
           {nodes(R"([{"matrix": [1, 2]}])"), "/nodes/0/matrix: is not an array of 16 numbers"},
           {nodes(R"([{"scale": [1, 2, "3"]}])"), "/nodes/0/scale: is not an array of 3 numbers"},
           {nodes(R"({})"), "/nodes: is not an array"},
           {meshes(R"([{"primitives": {}}])"), "/meshes/0/primitives: is not an array"},
           {meshes(R"([{"primitives": [{"attributes": {}}]}])"),
            "/meshes/0/primitives/0: the attribute POSITION is missing"},
           {meshes(R"([{"primitives": [{"attributes": {"POSITION": 5}}]}])"),
            "/accessors/5: does not exist; the file has 2"},
           {meshes(R"([{"primitives": [{"attributes": {"POSITION": -1}}]}])"),
            "/meshes/0/primitives/0/attributes/POSITION: is not an integer from 0 on"},
           {accessors(position, R"("bufferView": 1, "componentType": 5123, "count": 36.5,
             "type": "SCALAR")"),
            "/accessors/1/count: is not an integer from 0 on"},
           {accessors(position, R"("bufferView": 1, "componentType": 5126, "count": 1,
             "type": "SCALAR")"),
            "/accessors/1: has components of type FLOAT"},
           {accessors(position, R"("bufferView": 1, "componentType": 5124, "count": 3,
             "type": "SCALAR")"),
            "/accessors/1: has the componentType 5124"},
           {accessors(R"("bufferView": 0, "componentType": 5126, "count": 5, "type": "VEC3")",
                      index),
            "/accessors/0: 5 elements of 12 bytes, 12 apart, from byte 0 on, do not fit into the "
            "48 bytes of bufferView 0"},
           {accessors(R"("bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3",
             "byteOffset": 18446744073709551615)",
                      index),
            "/accessors/0: 4 elements"},
           {accessors(R"("componentType": 5126, "count": 4000000000, "type": "VEC3")", index),
            "/accessors/0: has no bufferView and no sparse values"},
           {accessors(R"("componentType": 5126, "count": 4000000000, "type": "VEC3", "sparse":
             {"count": 0, "indices": {"bufferView": 0, "componentType": 5121},
              "values": {"bufferView": 0}})",
                      index),
            "/accessors/0: has 4000000000 elements of value 0 without a bufferView"},
           {accessors(R"("bufferView": 9, "componentType": 5126, "count": 4, "type": "VEC3")",
                      index),
            "/accessors/0: the bufferView 9 does not exist"},
           {views(R"([{"buffer": 3, "byteLength": 48}, {"buffer": 0, "byteLength": 6}])"),
            "/bufferViews/0: the buffer 3 does not exist; the file has 1"},
           {views(R"([{"buffer": 0, "byteLength": 480}, {"buffer": 0, "byteLength": 6}])"),
            "/bufferViews/0: 480 bytes from byte 0 on do not fit into the 54 bytes of buffer 0"},
           {views(R"([{"buffer": 0, "byteOffset": 18446744073709551610, "byteLength": 48},
                      {"buffer": 0, "byteLength": 6}])"),
            "/bufferViews/0: 48 bytes"},
           {with([](GltfParts& p) { p.binary[50] = 4; }),
            "/meshes/0/primitives/0/indices: index 1 is vertex 4; the primitive has 4"},
           {with([](GltfParts& p) { p.binary.replace(0, 4, Raw(INFINITY)); }),
            "/meshes/0/primitives/0: x of vertex 0 (counted from 0), as node 0 places it: the "
            "coordinate 'inf' is not finite"},
           {nodes(R"([{"mesh": 0, "scale": [1e39, 1, 1]}])"), "is beyond 3.4e38"},
           {GltfParts().Json(R"([{"byteLength": 54, "uri": "../x.bin"}])"),
            "/buffers/0: the data is in another file, '../x.bin'; only embedded buffers are read"},
           {GltfParts().Json(R"([{"byteLength": 54, "uri": "http://127.0.0.1/x"}])"),
            "only embedded buffers are read"},
           {GltfParts().Json(R"([{"byteLength": 54}])"), "/buffers/0: has no 'uri'"},
           {GltfParts().Json(R"([{"byteLength": 54, "uri": "data:,abc"}])"),
            "/buffers/0: claims 54 bytes"},
           {GltfParts().Json(R"([{"byteLength": 54, "uri": "data:x;base64,)" +
                             std::string(71, '!') + "\"}]"),
            "/buffers/0: the data: URI is not valid base64"},
           {R"({"asset": {"version": "1.0"}})", "/asset: needs glTF '1.0'; 2.0 is read"},
           {R"({"asset": {"version": "2.0", "minVersion": "2.1"}})", "/asset: needs glTF '2.1'"},
           {"{\"asset\": {\"version\": \"2.0\"}, }", "the text is not JSON here"},
           {"{\"asset\": {\"version\": \"2.0\"}", "the text is not JSON here, at its end"},
       }) {
    const Error error = MustRefuse(c.file);
    EXPECT_EQ(error.code, ErrorCode::kInvalidMesh) << c.file;
    EXPECT_THAT(error.message, HasSubstr(c.message));
  }
}

TEST(GltfReader, RefusesABrokenContainerWithTheByte) {
  const std::string good = GltfParts().Glb();
  const auto with = [&](std::size_t at, std::uint32_t number) {
    std::string file = good;
    return file.replace(at, 4, Raw(number));
  };
  for (const auto& [file, byte] : {std::pair{good.substr(0, 8), 8},
                                   {with(4, 3), 4},
                                   {with(8, 4'000'000'000), 8},
                                   {good.substr(0, good.size() - 4), 8},
                                   {with(12, 4'000'000'000), 12},
                                   {with(16, 0), 12}}) {
    const Error error = MustRefuse(file);
    EXPECT_EQ(error.code, ErrorCode::kInvalidMesh);
    EXPECT_EQ(error.byte, static_cast<std::uint64_t>(byte)) << error.message;
  }
  // The byte of a mistake in the JSON is that of the file.
  std::string broken = good;
  broken[20] = 'x';
  EXPECT_EQ(MustRefuse(broken).code, ErrorCode::kInvalidMesh);
  EXPECT_EQ(MustRefuse(broken).byte, 20u);
  ExpectCorners(good + "tail", kTriangle);
}

TEST(GltfReader, IgnoresWhatItDoesNotNeedWhateverItIs) {
  GltfParts parts;
  parts.more = R"("materials": 7, "images": [{"uri": "http://127.0.0.1/x.png"}], "skins": "none",
    "animations": [null], "extensionsUsed": ["KHR_materials_unlit"], "extras": {"a": [[{}]]}, )";
  parts.nodes = R"([{"mesh": 0, "name": 3, "skin": 9, "weights": [1]}])";
  parts.meshes = R"([{"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 77}, "indices": 1,
    "targets": [{"POSITION": 99}], "material": -1}]}])";
  ExpectCorners(parts.Text(), kTriangle);
}

TEST(GltfReader, CountsInstancesBeforeItTakesMemoryForThem) {
  // 20,000 nodes that show one mesh of 20,000 triangles: half a megabyte that means 400 million.
  GltfParts parts;
  std::string nodes = "[";
  std::string roots;
  for (int i = 0; i < 20000; ++i) {
    nodes += i == 0 ? R"({"mesh": 0})" : R"(,{"mesh": 0})";
    roots += (i == 0 ? "" : ",") + std::to_string(i);
  }
  parts.nodes = nodes + "]";
  parts.scenes = R"("scenes": [{"nodes": [)" + roots + "]}]";
  for (int i = 1; i < 20000; ++i) parts.binary += RawList<std::uint16_t>({0, 1, 2});
  parts.accessors = R"([{"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
          {"bufferView": 1, "componentType": 5123, "count": 60000, "type": "SCALAR"}])";
  parts.views = R"([{"buffer": 0, "byteLength": 48},
          {"buffer": 0, "byteOffset": 48, "byteLength": 120000}])";
  MeshCounts last;
  MeshReadOptions options;
  options.on_counts = [&](const MeshCounts& counts) -> Status {
    last = counts;
    if (counts.triangles == 0) return {};
    return Error{ErrorCode::kMemoryFull, "no"};
  };
  const Result<MeshData> mesh = ReadMesh(test::Bytes(parts.Glb()), options);
  ASSERT_FALSE(mesh.ok());
  EXPECT_EQ(mesh.error().code, ErrorCode::kMemoryFull);
  EXPECT_EQ(last.triangles, 400'000'000u);
  EXPECT_EQ(last.vertices, 80'000u);
}

TEST(GltfReader, LimitsTheNestingAndTheNumberOfJsonValues) {
  const auto nested = [](std::size_t levels) {
    GltfParts parts;
    parts.more = R"("extras": )" + std::string(levels, '[') + std::string(levels, ']') + ", ";
    return parts.Text();
  };
  ExpectCorners(nested(100), kTriangle);
  EXPECT_THAT(MustRefuse(nested(1'000'000)).message, HasSubstr("nested deeper than 128 levels"));
  GltfParts parts;
  std::string zeros;
  for (std::uint64_t i = 0; i < kMaxGltfValues; ++i) zeros += "0,";
  parts.more = R"("extras": [)" + zeros + "0], ";
  EXPECT_EQ(MustRefuse(parts.Text()).code, ErrorCode::kMeshTooLarge);
}

TEST(GltfReader, DoesNotCopyLongStrings) {
  GltfParts parts;
  parts.more = R"("extras": ["\")" + std::string(1 << 20, 'x') + R"(", "data:,)" +
               std::string(1 << 20, 'y') + R"("], )";
  MeshReadOptions options;
  std::uint64_t most = 0;
  options.on_counts = [&](const MeshCounts& counts) -> Status {
    most = std::max(most, counts.other_bytes);
    return {};
  };
  const auto mesh = ReadMesh(test::Bytes(parts.Text()), options);
  ASSERT_TRUE(mesh.ok()) << mesh.error().message;
  EXPECT_LT(most, 64u << 10);
}

TEST(GltfReader, ReadsBase64WithEscapedSlashesAndWithoutPadding) {
  GltfParts parts;
  parts.binary.replace(36, 3, "\xff\xff\xff");  // four slashes
  std::string text = parts.Text();
  const std::size_t slashes = text.find("////");
  ASSERT_NE(slashes, std::string::npos);
  const MeshData plain = MustRead(text);
  text.replace(slashes, 4, R"(\/\/\/\/)");
  EXPECT_EQ(MustRead(text).vertices, plain.vertices);
}

TEST(GltfReader, StopsSoonAfterItsCancellation) {
  using std::chrono::milliseconds;
  GltfParts nodes;
  std::string list = "[{}";
  for (int i = 1; i < 100'000; ++i) list += ",{}";
  nodes.nodes = list + "]";
  nodes.scenes = R"("extras": 0)";
  GltfParts extras;
  extras.more = R"("extras": [)" + std::string(10'000'000, ' ') + "\"" +
                std::string(10'000'000, 'x') + "\"], ";
  GltfParts data;
  data.binary += std::string(10'000'000, '\1');
  for (const std::string& text : {nodes.Text(), extras.Text(), data.Text()}) {
    const std::vector<std::byte> bytes = test::Bytes(text);
    for (const int after : {0, 5, 20}) {
      MeshReadOptions options;
      options.cancel = CancelToken::WithDeadline(CancelToken::Clock::now() + milliseconds(after));
      const auto start = std::chrono::steady_clock::now();
      const Result<MeshData> mesh = ReadMesh(bytes, options);
      if (mesh.ok() || mesh.error().code != ErrorCode::kDeadlineExceeded) continue;
      EXPECT_LT(std::chrono::steady_clock::now() - start, milliseconds(after + 250));
    }
  }
}

constexpr AttributeKinds kAllKinds = {AttributeKind::kUv, AttributeKind::kShadingNormal,
                                      AttributeKind::kColor, AttributeKind::kGroup,
                                      AttributeKind::kEdges};

TEST(GltfReader, MissesAttributesOfABrokenBufferAndReadsTheTriangles) {
  GltfParts parts;
  parts.views = R"([{"buffer": 0, "byteLength": 48}, {"buffer": 0, "byteOffset": 48,
    "byteLength": 6}, {"buffer": 1, "byteLength": 48}])";
  parts.accessors = R"([{"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
    {"bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR"},
    {"bufferView": 2, "componentType": 5126, "count": 4, "type": "VEC3"}])";
  parts.meshes =
      R"([{"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 2}, "indices": 1}]}])";
  const std::string first = R"([{"byteLength": 54, "uri": "data:;base64,)" + Base64(parts.binary);
  for (const char* second : {R"({"byteLength": 48, "uri": "data:;base64,????")",
                             R"({"byteLength": 3, "uri": "data:;base64,AAAA")",
                             R"({"byteLength": 48, "uri": "normals.bin")"}) {
    const std::string text = parts.Json(first + "\"}, " + second + "}]");
    ExpectCorners(text, kTriangle);
    const auto mesh = ReadAttributes(test::Bytes(text), kAllKinds);
    ASSERT_TRUE(mesh.ok()) << mesh.error().message;
    EXPECT_TRUE(std::isnan(mesh->ShadingNormal(0, 0, 0).x));
  }
}

TEST(GltfReader, ReadsAttributesOfEachPrimitiveAndNode) {
  GltfParts parts;
  parts.binary = RawList<float>({0, 0, 0, 1, 0, 0, 0, 1, 0}) +         // positions, from byte 0
                 RawList<float>({0, 0, 1, 0, 0, 1, 1, 0, 1}) +         // normals, from 36
                 RawList<std::uint16_t>({0, 0, 65535, 0, 0, 32768}) +  // uv, from 72
                 RawList<std::uint8_t>({255, 0, 0, 255, 0, 255, 0, 0, 0, 0, 128, 9});  // from 84
  parts.views = R"([{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36,
    "byteLength": 36}, {"buffer": 0, "byteOffset": 72, "byteLength": 12},
    {"buffer": 0, "byteOffset": 84, "byteLength": 12}])";
  parts.accessors = R"([{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"},
    {"bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC3"},
    {"bufferView": 2, "componentType": 5123, "count": 3, "type": "VEC2", "normalized": true},
    {"bufferView": 3, "componentType": 5121, "count": 3, "type": "VEC4", "normalized": true}])";
  parts.meshes = R"([{"name": "m", "primitives": [{"attributes": {"POSITION": 0, "NORMAL": 1,
    "TEXCOORD_0": 2, "COLOR_0": 3}}, {"attributes": {"POSITION": 0}}]},
    {"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 1}}]}])";
  parts.nodes = R"([{"mesh": 0, "scale": [1, 1, 2]}, {"mesh": 1, "name": "mirrored",
    "scale": [1, 1, -1]}, {"mesh": 1, "name": ""}])";
  parts.scenes = R"("scenes": [{"nodes": [0, 1, 2]}])";
  const auto read = ReadAttributes(test::Bytes(parts.Glb()), kAllKinds);
  ASSERT_TRUE(read.ok()) << read.error().message;
  const MeshAttributes& mesh = *read;
  EXPECT_THAT(std::vector<std::string>(mesh.group_names().begin(), mesh.group_names().end()),
              ElementsAre("m/0", "m/1", "mirrored", "node 2"));
  for (PrimitiveId id = 0; id < 4; ++id) EXPECT_EQ(mesh.Group(id), static_cast<int>(id));
  EXPECT_EQ(mesh.Uv(0, 1, 0)[0], 1);
  EXPECT_NEAR(mesh.Uv(0, 0, 1)[1], 32768.0 / 65535, 1e-15);
  EXPECT_TRUE(std::isnan(mesh.Uv(1, 0, 0)[0]));
  // The inverse transpose halves z and keeps x: (1, 0, 1) becomes (1, 0, 0.5).
  ExpectNear(mesh.ShadingNormal(0, 0, 1), {2 / std::sqrt(5), 0, 1 / std::sqrt(5)}, 1e-7);
  EXPECT_TRUE(std::isnan(mesh.ShadingNormal(1, 0, 0).x));
  // A mirrored normal points to the mirrored side; corners 2 and 3 are exchanged.
  ExpectNear(mesh.ShadingNormal(2, 0, 0), {0, 0, -1}, 1e-7);
  const double half = std::sqrt(0.5);
  ExpectNear(mesh.ShadingNormal(2, 1, 0), {half, 0, -half}, 1e-7);
  ExpectNear(mesh.ShadingNormal(3, 0, 1), {half, 0, half}, 1e-7);
  // Colours are linear as they stand.
  ExpectNear(mesh.Color(0, 0, 0), {1, 0, 0}, 1e-7);
  ExpectNear(mesh.Color(0, 0, 1), {0, 0, 128 / 255.0}, 1e-7);
  EXPECT_TRUE(std::isnan(mesh.Color(1, 0, 0).x));
  EXPECT_FALSE(mesh.has(AttributeKind::kEdges));
}

}  // namespace
}  // namespace kdray::core
