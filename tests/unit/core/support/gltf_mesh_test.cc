// SPDX-License-Identifier: Apache-2.0
// The tests' own reader of glTF (tests/support/gltf_mesh.h), on files made here and on the
// collection.
#include "tests/support/gltf_mesh.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <stdexcept>
#include <string>
#include <vector>

#include "core/geometry/triangle_mesh.h"
#include "tests/support/csv.h"
#include "tests/support/mesh_files.h"

namespace kdray::test {
namespace {

using core::MeshData;
using core::TriangleIndices;
using core::Vec3d;

template <class T>
std::string Raw(const std::vector<T>& values) {
  std::string bytes(values.size() * sizeof(T), '\0');
  if (!values.empty()) std::memcpy(bytes.data(), values.data(), bytes.size());
  return bytes;
}

std::string Glb(std::string json, std::string binary) {
  json.resize((json.size() + 3) / 4 * 4, ' ');
  binary.resize((binary.size() + 3) / 4 * 4, '\0');
  const auto word = [](std::size_t n) {
    return Raw<std::uint32_t>({static_cast<std::uint32_t>(n)});
  };
  return "glTF" + word(2) + word(28 + json.size() + binary.size()) + word(json.size()) + "JSON" +
         json + word(binary.size()) + std::string("BIN\0", 4) + binary;
}

MeshData Read(const std::string& file) { return ReadGltf(Bytes(file)); }

// Three vertices 16 bytes apart, then the indices 2, 0, 1.
const std::string kTriangle =
    Raw<float>({1, 2, 3, 9, 4, 5, 6, 9, 7, 8, 10, 9}) + Raw<std::uint16_t>({2, 0, 1});
const char* const kTriangleJson = R"(
  "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
  "accessors": [{"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 3},
                {"bufferView": 1, "componentType": 5123, "type": "SCALAR", "count": 3}],
  "bufferViews": [{"buffer": 0, "byteLength": 48, "byteStride": 16},
                  {"buffer": 0, "byteOffset": 48, "byteLength": 6}],
  "buffers": [{"byteLength": 54}]})";

TEST(GltfMesh, AppliesScaleThenRotationThenTranslation) {
  // A quarter turn about z: x becomes y, y becomes -x.
  const MeshData mesh = Read(Glb(std::string(R"({"scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0,
    "translation": [100, 200, 300], "rotation": [0, 0, 0.7071067811865476, 0.7071067811865476],
    "scale": [2, 3, 4]}],)") + kTriangleJson,
                                 kTriangle));
  ASSERT_EQ(mesh.vertices.size(), 3u);
  EXPECT_EQ(mesh.triangles, (std::vector<TriangleIndices>{{2, 0, 1}}));
  const std::vector<Vec3d> stored = {{1, 2, 3}, {4, 5, 6}, {7, 8, 10}};
  for (std::size_t i = 0; i < 3; ++i) {
    const Vec3d expected{100 - 3 * stored[i].y, 200 + 2 * stored[i].x, 300 + 4 * stored[i].z};
    EXPECT_LT(MaxAbs(mesh.vertices[i] - expected), 1e-12);
  }
}

TEST(GltfMesh, WalksTheDefaultSceneDepthFirstAndAppliesParentsLast) {
  // Node 0 is in another scene. The parent mirrors x and doubles; its child moves by 10 along x.
  const MeshData mesh = Read(Glb(std::string(R"({"scene": 1,
    "scenes": [{"nodes": [0]}, {"nodes": [1, 3]}],
    "nodes": [{"mesh": 0, "translation": [1e6, 0, 0]},
              {"children": [2], "matrix": [-2, 0, 0, 0,  0, 2, 0, 0,  0, 0, 2, 0,  0, 0, 5, 1]},
              {"mesh": 0, "translation": [10, 0, 0]},
              {"mesh": 0}],)") + kTriangleJson,
                                 kTriangle));
  EXPECT_EQ(mesh.vertices,
            (std::vector<Vec3d>{
                {-22, 4, 11}, {-28, 10, 17}, {-34, 16, 25}, {1, 2, 3}, {4, 5, 6}, {7, 8, 10}}));
  EXPECT_EQ(mesh.triangles, (std::vector<TriangleIndices>{{2, 0, 1}, {5, 3, 4}}));
}

TEST(GltfMesh, RefusesWhatItDoesNotRead) {
  const std::string good =
      std::string(R"({"scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],)") + kTriangleJson;
  EXPECT_EQ(Read(Glb(good, kTriangle)).triangles.size(), 1u);
  const auto with = [&](const std::string& old_text, const std::string& new_text) {
    std::string json = good;
    json.replace(json.find(old_text), old_text.size(), new_text);
    return Glb(json, kTriangle);
  };
  for (const std::string& file : {
           with("\"indices\": 1", "\"indices\": 1, \"mode\": 5"),
           with("\"byteLength\": 54", "\"byteLength\": 54, \"uri\": \"other.bin\""),
           with("{\"mesh\": 0}", "{\"mesh\": 0, \"children\": [0]}"),
           with("\"scenes\"",
                "\"extensionsRequired\": [\"KHR_draco_mesh_compression\"], \"scenes\""),
           with("5126", "5122"),
           with("\"byteLength\": 6", "\"byteLength\": 5"),
           with("\"byteOffset\": 48", "\"byteOffset\": 40"),  // indices beyond the vertices
           with("\"byteLength\": 54", "\"byteLength\": 60"),
           Glb(good, kTriangle).substr(0, 200),
           std::string("{"),
       }) {
    EXPECT_THROW(Read(file), std::exception) << file;
  }
}

TEST(GltfMesh, ReadsTheCollectionsFilesAsItsListHasThem) {
  KDRAY_NEED_MESHES();
  int read = 0;
  for (const CsvRow& row : ReadCsv(*MeshFolder() / "MANIFEST.csv")) {
    const std::string& file = row.at("file");
    if (row.at("format") != "glb" && row.at("format") != "gltf") continue;
    SCOPED_TRACE(file);
    const std::vector<std::byte> bytes = ReadFileBytes(*MeshFolder() / file);
    if (file == "mode5_strips.gltf") {
      EXPECT_THROW(ReadGltf(bytes), std::runtime_error);
      continue;
    }
    ++read;
    const MeshData data = ReadGltf(bytes);
    EXPECT_EQ(std::to_string(data.triangles.size()), row.at("triangles"));
    EXPECT_EQ(std::to_string(data.vertices.size()), row.at("vertices_in_file"));
    const auto mesh = core::TriangleMesh::Create(data);
    ASSERT_TRUE(mesh.ok()) << mesh.error().message;
    // The collection's bounds are those of floats, with 9 digits.
    const double tolerance =
        0x1p-23 * std::max(MaxAbs(mesh->bounds().min), MaxAbs(mesh->bounds().max));
    for (int axis = 0; axis < 3; ++axis) {
      const std::string letter(1, "xyz"[axis]);
      EXPECT_NEAR(mesh->bounds().min[axis], std::stod(row.at("min" + letter)), tolerance);
      EXPECT_NEAR(mesh->bounds().max[axis], std::stod(row.at("max" + letter)), tolerance);
    }
  }
  EXPECT_EQ(read, 17);
}

}  // namespace
}  // namespace kdray::test
