// SPDX-License-Identifier: Apache-2.0
// Draco data in glTF files, encoded here by the library's own encoder.
#include <draco/compression/decode.h>
#include <draco/compression/encode.h>
#include <draco/mesh/mesh.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "core/io/draco_process.h"
#include "core/io/gltf_reader.h"
#include "core/io/mesh_attributes.h"
#include "tests/support/cancel_probe.h"
#include "tests/support/seed.h"
#include "tests/support/shapes.h"
#include "tests/unit/core/io/gltf_texts.h"

namespace kdray::core {
namespace {

using testing::HasSubstr;

// The encoder's settings.
struct Setting {
  int method = draco::MESH_EDGEBREAKER_ENCODING;
  int speed = 5;  // from 5 on, and for small meshes, another encoding of the triangles
  int bits = 11;  // of a quantized coordinate; 0: floats
};

// Draco data of one primitive: ids are 0 for positions, 1 for normals, 2 for texture coordinates.
struct Encoded {
  std::string bytes;
  std::uint64_t vertices = 0;
  std::uint64_t triangles = 0;
};

int AddFloats(draco::Mesh* mesh, draco::GeometryAttribute::Type type, int components,
              const std::vector<float>& values) {
  draco::GeometryAttribute attribute;
  attribute.Init(type, nullptr, static_cast<std::int8_t>(components), draco::DT_FLOAT32, false,
                 static_cast<std::int64_t>(sizeof(float)) * components, 0);
  const auto count =
      static_cast<std::uint32_t>(values.size()) / static_cast<std::uint32_t>(components);
  const int id = mesh->AddAttribute(attribute, true, count);
  for (std::uint32_t i = 0; i < count; ++i) {
    mesh->attribute(id)->SetAttributeValue(draco::AttributeValueIndex(i),
                                           &values[i * static_cast<std::uint32_t>(components)]);
  }
  return id;
}

Encoded Encode(const MeshData& data, const Setting& setting) {
  draco::Mesh mesh;
  std::vector<float> positions, normals, uvs;
  for (const Vec3d& v : data.vertices) {
    const double length = std::sqrt(Dot(v, v));
    for (int axis = 0; axis < 3; ++axis) {
      positions.push_back(static_cast<float>(v[axis]));
      normals.push_back(static_cast<float>(length > 0 ? v[axis] / length : axis == 0));
    }
    uvs.push_back(static_cast<float>(v.x));
    uvs.push_back(static_cast<float>(v.y));
  }
  mesh.set_num_points(static_cast<std::uint32_t>(data.vertices.size()));
  AddFloats(&mesh, draco::GeometryAttribute::POSITION, 3, positions);
  AddFloats(&mesh, draco::GeometryAttribute::NORMAL, 3, normals);
  AddFloats(&mesh, draco::GeometryAttribute::TEX_COORD, 2, uvs);
  for (const TriangleIndices& t : data.triangles) {
    mesh.AddFace({draco::PointIndex(t[0]), draco::PointIndex(t[1]), draco::PointIndex(t[2])});
  }
  draco::Encoder encoder;
  encoder.SetTrackEncodedProperties(true);
  encoder.SetEncodingMethod(setting.method);
  encoder.SetSpeedOptions(setting.speed, setting.speed);
  if (setting.bits > 0) {
    encoder.SetAttributeQuantization(draco::GeometryAttribute::POSITION, setting.bits);
    encoder.SetAttributeQuantization(draco::GeometryAttribute::NORMAL, 10);
    encoder.SetAttributeQuantization(draco::GeometryAttribute::TEX_COORD, 12);
  }
  draco::EncoderBuffer buffer;
  EXPECT_TRUE(encoder.EncodeMeshToBuffer(mesh, &buffer).ok());
  return {
      {buffer.data(), buffer.size()}, encoder.num_encoded_points(), encoder.num_encoded_faces()};
}

// What the library decodes in this process: the oracle.
MeshData Decoded(const std::string& bytes) {
  draco::DecoderBuffer buffer;
  buffer.Init(bytes.data(), bytes.size());
  draco::Decoder decoder;
  auto mesh = decoder.DecodeMeshFromBuffer(&buffer);
  MeshData data;
  if (!mesh.ok()) return data;
  const draco::PointAttribute* positions =
      mesh.value()->GetNamedAttribute(draco::GeometryAttribute::POSITION);
  for (std::uint32_t i = 0; i < mesh.value()->num_points(); ++i) {
    float p[3];
    positions->GetMappedValue(draco::PointIndex(i), p);
    data.vertices.push_back(
        {static_cast<double>(p[0]), static_cast<double>(p[1]), static_cast<double>(p[2])});
  }
  for (std::uint32_t i = 0; i < mesh.value()->num_faces(); ++i) {
    const auto& face = mesh.value()->face(draco::FaceIndex(i));
    data.triangles.push_back({face[0].value(), face[1].value(), face[2].value()});
  }
  return data;
}

// A glTF file around the data, whose JSON values a test may replace.
struct DracoParts {
  std::string bytes;
  std::string position = R"("componentType": 5126, "type": "VEC3", "count": )";
  std::string indices = R"("componentType": 5125, "type": "SCALAR", "count": )";
  std::uint64_t vertices = 0;
  std::uint64_t corners = 0;
  std::string primitive =
      R"("attributes": {"POSITION": 0, "NORMAL": 2, "TEXCOORD_0": 3}, "indices": 1)";
  std::string extension =
      R"("bufferView": 0, "attributes": {"POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2})";
  std::string nodes = R"([{"mesh": 0}])";

  explicit DracoParts(const Encoded& encoded)
      : bytes(encoded.bytes), vertices(encoded.vertices), corners(3 * encoded.triangles) {}

  std::string Glb() const {
    GltfParts parts;
    parts.more = R"("extensionsUsed": ["KHR_draco_mesh_compression"],
                    "extensionsRequired": ["KHR_draco_mesh_compression"], )";
    parts.nodes = nodes;
    parts.meshes = R"([{"primitives": [{)" + primitive +
                   R"(, "extensions": {"KHR_draco_mesh_compression": {)" + extension + "}}}]}]";
    const std::string count = std::to_string(vertices);
    parts.accessors = "[{" + position + count + "}, {" + indices + std::to_string(corners) +
                      R"(}, {"componentType": 5126, "type": "VEC3", "count": )" + count +
                      R"(}, {"componentType": 5126, "type": "VEC2", "count": )" + count + "}]";
    parts.views = R"([{"buffer": 0, "byteLength": )" + std::to_string(bytes.size()) + "}]";
    parts.binary = bytes;
    return parts.Glb();
  }
};

const MeshData& Sphere() {
  static const MeshData mesh = test::BumpySphere({1, 2, 3}, 2, 24, 40, 0.2);
  return mesh;
}

TEST(GltfDraco, ReadsWhatTheLibraryDecodesBitForBit) {
  for (const int method : {draco::MESH_SEQUENTIAL_ENCODING, draco::MESH_EDGEBREAKER_ENCODING}) {
    for (const int speed : {0, 3, 5, 10}) {
      for (const int bits : {0, 11}) {
        SCOPED_TRACE(std::to_string(method) + " " + std::to_string(speed));
        const Encoded encoded = Encode(Sphere(), {method, speed, bits});
        const MeshData expected = Decoded(encoded.bytes);
        ASSERT_EQ(expected.triangles.size(), Sphere().triangles.size());
        const MeshData mesh = MustRead(DracoParts(encoded).Glb());
        EXPECT_TRUE(mesh.vertices == expected.vertices);
        EXPECT_TRUE(mesh.triangles == expected.triangles);
      }
    }
  }
}

TEST(GltfDraco, ReadsTheMeshThatWasEncodedWithinItsQuantization) {
  const MeshData mesh =
      MustRead(DracoParts(Encode(Sphere(), {draco::MESH_SEQUENTIAL_ENCODING, 5, 11})).Glb());
  // This method keeps the order of triangles and their corners.
  ASSERT_EQ(mesh.triangles.size(), Sphere().triangles.size());
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) {
      const Vec3d read = mesh.vertices[mesh.triangles[i][k]];
      const Vec3d given = Sphere().vertices[Sphere().triangles[i][k]];
      for (int axis = 0; axis < 3; ++axis) ASSERT_NEAR(read[axis], given[axis], 4.8 / 2047 * 0.51);
    }
  }
}

TEST(GltfDraco, ReadsNormalsAndTextureCoordinates) {
  const Encoded encoded = Encode(Sphere(), {});
  const std::string glb = DracoParts(encoded).Glb();
  const MeshData mesh = MustRead(glb);
  const auto attributes =
      ReadAttributes(test::Bytes(glb), {AttributeKind::kUv, AttributeKind::kShadingNormal});
  ASSERT_TRUE(attributes.ok()) << attributes.error().message;
  for (PrimitiveId id = 0; id < mesh.triangles.size(); ++id) {
    const Vec3d v = mesh.vertices[mesh.triangles[id][0]];
    const double length = std::sqrt(Dot(v, v));
    const Vec3d normal = attributes->ShadingNormal(id, 0, 0);
    for (int axis = 0; axis < 3; ++axis) ASSERT_NEAR(normal[axis], v[axis] / length, 0.01);
    ASSERT_NEAR(attributes->Uv(id, 0, 0)[0], v.x, 0.01);
    ASSERT_NEAR(attributes->Uv(id, 0, 0)[1], v.y, 0.01);
  }
  // Normals of another type than the accessor says are as if there were none.
  DracoParts parts(encoded);
  parts.extension =
      R"("bufferView": 0, "attributes": {"POSITION": 0, "NORMAL": 2, "TEXCOORD_0": 9})";
  const auto without =
      ReadAttributes(test::Bytes(parts.Glb()), {AttributeKind::kUv, AttributeKind::kShadingNormal});
  ASSERT_TRUE(without.ok()) << without.error().message;
  EXPECT_TRUE(std::isnan(without->ShadingNormal(0, 0, 0).x));
  EXPECT_TRUE(std::isnan(without->Uv(0, 0, 0)[0]));
}

TEST(GltfDraco, ShowsOneMeshAtSeveralNodes) {
  DracoParts parts(Encode(Sphere(), {}));
  const MeshData once = MustRead(parts.Glb());
  parts.nodes = R"([{"mesh": 0, "children": [1]}, {"mesh": 0, "translation": [10, 0, 0]}])";
  const MeshData twice = MustRead(parts.Glb());
  ASSERT_EQ(twice.vertices.size(), 2 * once.vertices.size());
  EXPECT_EQ(twice.vertices.back(), once.vertices.back() + Vec3d(10, 0, 0));
}

TEST(GltfDraco, SaysWhereDracoDataAreWrong) {
  const Encoded encoded = Encode(Sphere(), {});
  const std::string place = "/meshes/0/primitives/0/extensions/KHR_draco_mesh_compression: ";
  const auto refused = [&](const auto& change) {
    DracoParts parts(encoded);
    change(parts);
    const Error error = MustRefuse(parts.Glb());
    EXPECT_EQ(error.code, ErrorCode::kInvalidMesh) << error.message;
    return error.message;
  };
  const std::string counts = std::to_string(encoded.vertices) + " vertices and " +
                             std::to_string(encoded.triangles) + " triangles";
  EXPECT_THAT(refused([](DracoParts& p) { ++p.vertices; }),
              HasSubstr(place + "the Draco data have " + counts + "; the accessors say"));
  EXPECT_THAT(refused([](DracoParts& p) { p.corners += 3; }),
              HasSubstr(" vertices and " + std::to_string(encoded.triangles) +
                        " triangles; the accessors say"));
  EXPECT_EQ(refused([](DracoParts& p) { ++p.corners; }),
            "/accessors/1: has " + std::to_string(3 * encoded.triangles + 1) +
                " indices; those of Draco data are a multiple of 3");
  EXPECT_EQ(refused([](DracoParts& p) { p.bytes[0] = 'd'; }),
            place + "the data do not begin as Draco data");
  EXPECT_EQ(refused([](DracoParts& p) { p.bytes.resize(5); }),
            place + "the data do not begin as Draco data");
  EXPECT_EQ(refused([](DracoParts& p) { p.bytes[6] = '\1'; }),
            place + "the Draco data have version 2.1; 2.2 is read");
  EXPECT_EQ(refused([](DracoParts& p) { p.bytes[7] = '\0'; }),
            place + "the Draco data are not triangles");
  EXPECT_EQ(refused([](DracoParts& p) { p.bytes[8] = '\7'; }),
            place + "the Draco data have the method 7; 0 and 1 exist");
  EXPECT_EQ(refused([](DracoParts& p) { p.bytes.resize(p.bytes.size() / 2); }),
            place + "the Draco data are damaged");
  EXPECT_EQ(refused([](DracoParts& p) {
              p.extension = R"("bufferView": 0, "attributes": {"POSITION": 7})";
            }),
            place + "the Draco attribute 7 does not exist");
  EXPECT_EQ(refused([](DracoParts& p) {
              p.extension = R"("bufferView": 0, "attributes": {"POSITION": 2})";
            }),
            place + "the Draco attribute 2 has 2 components; the accessor says 3");
  EXPECT_EQ(refused([](DracoParts& p) {
              p.extension = R"("bufferView": 0, "attributes": {"POSITION": 4294967296})";
            }),
            place + "the id of the attribute POSITION is 4294967296; ids have 32 bits");
  EXPECT_EQ(refused([](DracoParts& p) {
              p.extension = R"("bufferView": 0, "attributes": {"NORMAL": 1})";
            }),
            place + "the attribute POSITION is missing");
  EXPECT_THAT(refused([](DracoParts& p) { p.extension = R"("attributes": {"POSITION": 0})"; }),
              HasSubstr("KHR_draco_mesh_compression: has no 'bufferView'"));
  EXPECT_EQ(refused([](DracoParts& p) {
              p.extension = R"("bufferView": 3, "attributes": {"POSITION": 0})";
            }),
            place + "the bufferView 3 does not exist; the file has 1");
  EXPECT_THAT(refused([](DracoParts& p) { p.primitive += R"(, "mode": 5)"; }),
              HasSubstr("has Draco data and the mode 5; of Draco data, the mode 4 (TRIANGLES)"));
  EXPECT_THAT(refused([](DracoParts& p) { p.primitive = R"("attributes": {"POSITION": 0})"; }),
              HasSubstr("has Draco data and no 'indices'"));
  EXPECT_THAT(refused([](DracoParts& p) {
                p.position = R"("componentType": 5123, "type": "VEC3", "count": )";
              }),
              HasSubstr("/accessors/0: has components of type UNSIGNED_SHORT"));
}

TEST(GltfDraco, ReportsTheMemoryOfTheDecoderBeforeItStarts) {
  const DracoParts parts(Encode(Sphere(), {}));
  std::uint64_t told = 0;
  MeshReadOptions options;
  options.on_counts = [&](const MeshCounts& counts) -> Status {
    told = counts.other_bytes;
    if (counts.triangles == 0) return {};
    return Error{ErrorCode::kMemoryFull, "no"};
  };
  const auto mesh = ReadMesh(test::Bytes(parts.Glb()), options);
  ASSERT_FALSE(mesh.ok());
  EXPECT_EQ(mesh.error().code, ErrorCode::kMemoryFull);
  EXPECT_GT(told, std::uint64_t{16} << 20);
}

TEST(GltfDraco, EndsTheDecoderSoonAfterACancellation) {
  const Encoded encoded = Encode(test::Grid(400, 2, 0), {});
  const std::string glb = DracoParts(encoded).Glb();
  for (const int milliseconds : {0, 40, 80}) {
    MeshReadOptions options;
    const auto begin = std::chrono::steady_clock::now();
    options.cancel = CancelToken::WithDeadline(begin + std::chrono::milliseconds(milliseconds));
    const auto mesh = ReadMesh(test::Bytes(glb), options);
    if (mesh.ok()) continue;  // a fast machine
    EXPECT_EQ(mesh.error().code, ErrorCode::kDeadlineExceeded) << mesh.error().message;
  }
  EXPECT_EQ(MustRead(glb).triangles.size(), encoded.triangles);
}

TEST(GltfDraco, RefusesOrReadsAnyDamage) {
  const Encoded encoded = Encode(test::BumpySphere({0, 0, 0}, 1, 6, 8, 0.1), {});
  std::mt19937_64 random(test::Seed() + 1);
  for (int i = 0; i < 60; ++i) {
    DracoParts parts(encoded);
    for (std::size_t n = 1 + random() % 3; n > 0; --n) {
      parts.bytes[11 + random() % (parts.bytes.size() - 11)] = static_cast<char>(random());
    }
    const auto mesh = ReadText(parts.Glb());
    if (mesh.ok()) continue;
    EXPECT_EQ(mesh.error().code, ErrorCode::kInvalidMesh) << mesh.error().message;
    EXPECT_FALSE(mesh.error().message.empty());
  }
}

}  // namespace
}  // namespace kdray::core
