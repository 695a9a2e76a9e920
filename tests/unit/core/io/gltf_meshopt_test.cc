// SPDX-License-Identifier: Apache-2.0
// Compressed buffer views in glTF files, encoded here by the library's own encoder.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <meshoptimizer.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <random>
#include <string>
#include <vector>

#include "core/io/gltf_reader.h"
#include "core/io/mesh_attributes.h"
#include "core/io/meshopt_decoder.h"
#include "tests/support/cancel_probe.h"
#include "tests/support/seed.h"
#include "tests/support/shapes.h"
#include "tests/unit/core/io/gltf_texts.h"

namespace kdray::core {
namespace {

using testing::HasSubstr;

template <class T>
std::string RawOf(const std::vector<T>& values) {
  return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T)};
}

std::string EncodedVertices(const std::string& raw, std::size_t stride) {
  const std::size_t count = raw.size() / stride;
  std::string encoded(meshopt_encodeVertexBufferBound(count, stride), '\0');
  meshopt_encodeVertexVersion(0);
  encoded.resize(meshopt_encodeVertexBuffer(reinterpret_cast<unsigned char*>(encoded.data()),
                                            encoded.size(), raw.data(), count, stride));
  return encoded;
}

std::string EncodedTriangles(const std::vector<std::uint32_t>& indices, std::size_t vertices) {
  std::string encoded(meshopt_encodeIndexBufferBound(indices.size(), vertices), '\0');
  meshopt_encodeIndexVersion(1);
  encoded.resize(meshopt_encodeIndexBuffer(reinterpret_cast<unsigned char*>(encoded.data()),
                                           encoded.size(), indices.data(), indices.size()));
  return encoded;
}

std::string EncodedIndices(const std::vector<std::uint32_t>& indices, std::size_t vertices) {
  std::string encoded(meshopt_encodeIndexSequenceBound(indices.size(), vertices), '\0');
  meshopt_encodeIndexVersion(1);
  encoded.resize(meshopt_encodeIndexSequence(reinterpret_cast<unsigned char*>(encoded.data()),
                                             encoded.size(), indices.data(), indices.size()));
  return encoded;
}

// A view of the file. `mode` is empty for one that is not compressed.
struct View {
  std::string bytes;  // as they are in the file
  std::string mode = "";
  std::size_t stride = 0;
  std::size_t count = 0;
  std::string filter = "";
};

// GltfParts with the views: the compressed ones name a second buffer that has no data.
struct CompressedParts {
  std::vector<View> views;
  std::string accessors;
  std::string meshes = R"([{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}])";
  std::string more = R"("extensionsUsed": ["EXT_meshopt_compression", "KHR_mesh_quantization"],
      "extensionsRequired": ["EXT_meshopt_compression"], )";
  std::string nodes = R"([{"mesh": 0}])";

  std::string Glb() const {
    GltfParts parts;
    parts.binary.clear();
    parts.views = "[";
    std::size_t fallback_bytes = 0;
    for (const View& view : views) {
      const std::string place = R"("byteOffset": )" + std::to_string(parts.binary.size()) +
                                R"(, "byteLength": )" + std::to_string(view.bytes.size());
      const std::string stride = R"("byteStride": )" + std::to_string(view.stride);
      parts.views += parts.views.size() > 1 ? ", " : "";
      if (view.mode.empty()) {
        parts.views += R"({"buffer": 0, )" + place + "}";
      } else {
        const std::size_t decoded = view.stride * view.count;
        parts.views += R"({"buffer": 1, "byteOffset": )" + std::to_string(fallback_bytes) +
                       R"(, "byteLength": )" + std::to_string(decoded) + ", " +
                       (view.mode == "ATTRIBUTES" ? stride + ", " : "") +
                       R"("extensions": {"EXT_meshopt_compression": {"buffer": 0, )" + place +
                       ", " + stride + R"(, "count": )" + std::to_string(view.count) +
                       R"(, "mode": ")" + view.mode + "\"" +
                       (view.filter.empty() ? "" : R"(, "filter": ")" + view.filter + "\"") + "}}}";
        fallback_bytes += decoded;
      }
      parts.binary += view.bytes;
      parts.binary.resize((parts.binary.size() + 3) / 4 * 4);
    }
    parts.views += "]";
    parts.accessors = accessors;
    parts.meshes = meshes;
    parts.more = more;
    parts.nodes = nodes;
    const std::string buffers =
        R"([{"byteLength": )" + std::to_string(parts.binary.size()) + R"(}, {"byteLength": )" +
        std::to_string(fallback_bytes) +
        R"(, "extensions": {"EXT_meshopt_compression": {"fallback": true}}}])";
    return GlbOf(parts.Json(buffers), parts.binary);
  }
};

std::string Accessor(std::size_t view, int type, std::size_t count, const std::string& kind,
                     bool normalized = false) {
  return R"({"bufferView": )" + std::to_string(view) + R"(, "componentType": )" +
         std::to_string(type) + R"(, "count": )" + std::to_string(count) + R"(, "type": ")" + kind +
         (normalized ? R"(", "normalized": true})" : "\"}");
}

constexpr int kByteType = 5120, kShortType = 5122, kUnsignedShortType = 5123, kUintType = 5125,
              kFloatType = 5126;

// A sphere as numbers of a glTF file.
struct Source {
  std::vector<float> positions;
  std::vector<std::uint32_t> indices;
  std::size_t vertices = 0;

  Source() {
    const MeshData mesh = test::BumpySphere({1, 2, 3}, 2, 12, 20, 0.2);
    vertices = mesh.vertices.size();
    for (const Vec3d& v : mesh.vertices) {
      for (int axis = 0; axis < 3; ++axis) positions.push_back(static_cast<float>(v[axis]));
    }
    for (const TriangleIndices& t : mesh.triangles) {
      indices.insert(indices.end(), t.begin(), t.end());
    }
  }

  std::string Accessors(int index_type = kUintType) const {
    return "[" + Accessor(0, kFloatType, vertices, "VEC3") + ", " +
           Accessor(1, index_type, indices.size(), "SCALAR") + "]";
  }
  MeshData Plain() const {
    CompressedParts parts;
    parts.views = {{RawOf(positions)}, {RawOf(indices)}};
    parts.accessors = Accessors();
    return MustRead(parts.Glb());
  }
  CompressedParts Compressed() const {
    CompressedParts parts;
    parts.views = {{EncodedVertices(RawOf(positions), 12), "ATTRIBUTES", 12, vertices},
                   {EncodedIndices(indices, vertices), "INDICES", 4, indices.size()}};
    parts.accessors = Accessors();
    return parts;
  }
};

TEST(GltfMeshopt, ReadsTheSameMeshAsWithoutCompression) {
  const Source source;
  const MeshData plain = source.Plain();
  ASSERT_EQ(plain.vertices.size(), source.vertices);
  const MeshData mesh = MustRead(source.Compressed().Glb());
  EXPECT_EQ(mesh.vertices, plain.vertices);
  EXPECT_EQ(mesh.triangles, plain.triangles);
}

TEST(GltfMeshopt, ReadsTheTrianglesThatTheLibraryDecodes) {
  const Source source;
  for (const std::size_t stride : {2, 4}) {
    const std::string encoded = EncodedTriangles(source.indices, source.vertices);
    // The codec keeps the order of triangles, and turns their corners.
    std::vector<std::uint32_t> decoded(source.indices.size());
    ASSERT_EQ(meshopt_decodeIndexBuffer(decoded.data(), decoded.size(),
                                        reinterpret_cast<const unsigned char*>(encoded.data()),
                                        encoded.size()),
              0);
    CompressedParts parts = source.Compressed();
    parts.views[1] = {encoded, "TRIANGLES", stride, source.indices.size()};
    parts.accessors = source.Accessors(stride == 2 ? kUnsignedShortType : kUintType);
    const MeshData mesh = MustRead(parts.Glb());
    ASSERT_EQ(mesh.triangles.size() * 3, decoded.size());
    for (std::size_t i = 0; i < decoded.size(); ++i) {
      ASSERT_EQ(mesh.triangles[i / 3][i % 3], decoded[i]) << i;
    }
    EXPECT_EQ(mesh.vertices, source.Plain().vertices);
  }
}

TEST(GltfMeshopt, ReadsQuantizedPositionsWithinTheirStep) {
  const Source source;
  std::vector<std::int16_t> quantized;
  for (std::size_t i = 0; i < source.positions.size(); ++i) {
    quantized.push_back(static_cast<std::int16_t>(std::lround(source.positions[i] / 8 * 32767)));
    if (i % 3 == 2) quantized.push_back(0);
  }
  CompressedParts parts = source.Compressed();
  parts.views[0] = {EncodedVertices(RawOf(quantized), 8), "ATTRIBUTES", 8, source.vertices};
  parts.accessors = "[" + Accessor(0, kShortType, source.vertices, "VEC3", true) + ", " +
                    Accessor(1, kUintType, source.indices.size(), "SCALAR") + "]";
  parts.nodes = R"([{"mesh": 0, "scale": [8, 8, 8]}])";
  const MeshData mesh = MustRead(parts.Glb());
  ASSERT_EQ(mesh.vertices.size(), source.vertices);
  for (std::size_t i = 0; i < source.positions.size(); ++i) {
    const double number = mesh.vertices[i / 3][static_cast<int>(i % 3)];
    EXPECT_NEAR(number, static_cast<double>(source.positions[i]), 8.0 / 32767 * 0.51);
    EXPECT_DOUBLE_EQ(number, 8.0 * quantized[i / 3 * 4 + i % 3] / 32767);
  }
}

TEST(GltfMeshopt, ReadsPositionsThroughTheExponentialFilter) {
  const Source source;
  std::vector<std::uint32_t> encoded;  // 2^-12 is the step
  for (const float number : source.positions) {
    const auto mantissa = static_cast<std::int32_t>(std::lround(number * 4096));
    encoded.push_back(static_cast<std::uint32_t>(-12) << 24 |
                      (static_cast<std::uint32_t>(mantissa) & 0xffffff));
  }
  CompressedParts parts = source.Compressed();
  parts.views[0] = {EncodedVertices(RawOf(encoded), 12), "ATTRIBUTES", 12, source.vertices,
                    "EXPONENTIAL"};
  const MeshData mesh = MustRead(parts.Glb());
  for (std::size_t i = 0; i < source.positions.size(); ++i) {
    const double number = mesh.vertices[i / 3][static_cast<int>(i % 3)];
    EXPECT_EQ(number * 4096, std::lround(source.positions[i] * 4096));
  }
}

TEST(GltfMeshopt, ReadsCompressedNormalsAndTextureCoordinates) {
  const Source source;
  CompressedParts parts = source.Compressed();
  std::vector<float> directions, uvs;
  for (std::size_t i = 0; i < source.vertices; ++i) {
    const double angle = 0.01 * static_cast<double>(i);
    for (const double c : {std::cos(angle), std::sin(angle), 0.0, 0.0}) {
      directions.push_back(static_cast<float>(c));
    }
    uvs.push_back(static_cast<float>(i));
    uvs.push_back(0.5f);
  }
  std::vector<std::int8_t> normals(directions.size());
  meshopt_encodeFilterOct(normals.data(), source.vertices, 4, 8, directions.data());
  parts.views.push_back(
      {EncodedVertices(RawOf(normals), 4), "ATTRIBUTES", 4, source.vertices, "OCTAHEDRAL"});
  parts.views.push_back({EncodedVertices(RawOf(uvs), 8), "ATTRIBUTES", 8, source.vertices, "NONE"});
  parts.accessors.back() = ',';
  parts.accessors += Accessor(2, kByteType, source.vertices, "VEC3", true) + ", " +
                     Accessor(3, kFloatType, source.vertices, "VEC2") + "]";
  parts.meshes =
      R"([{"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 2, "TEXCOORD_0": 3},
                           "indices": 1}]}])";
  const auto read = [](const std::string& glb) {
    return ReadAttributes(test::Bytes(glb), {AttributeKind::kUv, AttributeKind::kShadingNormal});
  };
  const auto attributes = read(parts.Glb());
  ASSERT_TRUE(attributes.ok()) << attributes.error().message;
  for (PrimitiveId id = 0; id < source.indices.size() / 3; ++id) {
    const std::uint32_t vertex = source.indices[3 * id];
    EXPECT_EQ(attributes->Uv(id, 0, 0)[0], vertex);
    const Vec3d normal = attributes->ShadingNormal(id, 0, 0);
    EXPECT_NEAR(normal.x, static_cast<double>(directions[4 * vertex]), 0.02);
    EXPECT_NEAR(normal.y, static_cast<double>(directions[4 * vertex + 1]), 0.02);
  }
  // Damaged normals are as if there were none; the mesh does not need them.
  parts.views[2].bytes[0] = 'x';
  const auto without = read(parts.Glb());
  ASSERT_TRUE(without.ok()) << without.error().message;
  EXPECT_TRUE(std::isnan(without->ShadingNormal(0, 0, 0).x));
  EXPECT_EQ(without->Uv(0, 0, 0)[1], 0.5);
}

TEST(GltfMeshopt, SaysWhereACompressedViewIsWrong) {
  const Source source;
  const std::string of_view = "/bufferViews/0/extensions/EXT_meshopt_compression: ";
  const auto refused = [&](const auto& change) {
    CompressedParts parts = source.Compressed();
    change(parts);
    const Error error = MustRefuse(parts.Glb());
    EXPECT_EQ(error.code, ErrorCode::kInvalidMesh) << error.message;
    return error.message;
  };
  const auto positions = [&](const auto& change) {
    return refused([&](CompressedParts& parts) { change(parts.views[0]); });
  };
  const auto indices = [&](const auto& change) {
    return refused([&](CompressedParts& parts) { change(parts.views[1]); });
  };
  EXPECT_EQ(positions([](View& v) { v.bytes[0] = 'x'; }),
            of_view + "the data do not begin as those of the mode ATTRIBUTES");
  // Version 1, which only newer libraries read, and which the extension does not have.
  EXPECT_EQ(positions([](View& v) { v.bytes[0] = '\xa1'; }),
            of_view + "the data do not begin as those of the mode ATTRIBUTES");
  EXPECT_EQ(positions([](View& v) { v.bytes.pop_back(); }),
            of_view + "the compressed data are damaged, or are not " +
                std::to_string(source.vertices) + " elements of 12 bytes");
  EXPECT_THAT(positions([](View& v) { v.stride = 14; }),
              HasSubstr(of_view + "has a byteStride of 14; allowed for ATTRIBUTES are multiples"));
  EXPECT_THAT(positions([](View& v) { v.stride = 260; }), HasSubstr("has a byteStride of 260;"));
  EXPECT_THAT(positions([](View& v) { v.stride = 0; }), HasSubstr("has a byteStride of 0;"));
  EXPECT_THAT(positions([](View& v) { v.mode = "POINTS"; }),
              HasSubstr("has the mode 'POINTS'; allowed are ATTRIBUTES, TRIANGLES, INDICES"));
  EXPECT_THAT(positions([](View& v) { v.filter = "BLUR"; }),
              HasSubstr("has the filter 'BLUR'; allowed are NONE, OCTAHEDRAL"));
  EXPECT_THAT(positions([](View& v) { v.filter = "OCTAHEDRAL"; }),
              HasSubstr("has a byteStride of 12; allowed for the filter OCTAHEDRAL are 4 and 8"));
  EXPECT_THAT(positions([](View& v) { v.filter = "QUATERNION"; }),
              HasSubstr("has a byteStride of 12; the filter QUATERNION needs 8"));
  EXPECT_THAT(indices([](View& v) { v.filter = "OCTAHEDRAL"; }),
              HasSubstr("has a filter, which the mode INDICES does not allow"));
  EXPECT_THAT(indices([](View& v) { v.stride = 1; }),
              HasSubstr("has a byteStride of 1; allowed for INDICES are 2 and 4"));
  EXPECT_THAT(indices([](View& v) {
                v.mode = "TRIANGLES";
                --v.count;
              }),
              HasSubstr("indices; the mode TRIANGLES needs a multiple of 3"));
  // The data of one mode are not those of another.
  EXPECT_THAT(indices([](View& v) { v.mode = "TRIANGLES"; }),
              HasSubstr("the data do not begin as those of the mode TRIANGLES"));
  // An index out of range.
  EXPECT_THAT(indices([&](View& v) {
                std::vector<std::uint32_t> wrong = source.indices;
                wrong[4] = static_cast<std::uint32_t>(source.vertices);
                v.bytes = EncodedIndices(wrong, source.vertices + 1);
              }),
              HasSubstr("/meshes/0/primitives/0/indices: index 4 is vertex"));
  // Fewer elements than the accessor has.
  EXPECT_THAT(positions([](View& v) { --v.count; }), HasSubstr("/accessors/0: "));
  // The compressed bytes are not in the file.
  EXPECT_THAT(refused([](CompressedParts& p) { p.views[1].bytes.clear(); }),
              HasSubstr("whose shortest encoding takes"));
}

TEST(GltfMeshopt, ChecksWhatAViewClaimsBeforeItTakesMemory) {
  const Source source;
  const auto message = [&](std::size_t count) {
    CompressedParts parts = source.Compressed();
    parts.views[0].count = count;
    std::uint64_t told = 0;
    MeshReadOptions options;
    options.on_counts = [&](const MeshCounts& counts) -> Status {
      told = std::max(told, counts.other_bytes);
      return {};
    };
    const auto mesh = ReadMesh(test::Bytes(parts.Glb()), options);
    EXPECT_FALSE(mesh.ok());
    EXPECT_LT(told, 1u << 20) << count;
    return mesh.error().message;
  };
  EXPECT_THAT(message(1'000'000), HasSubstr("claims 1000000 elements of 12 bytes, whose shortest"));
  EXPECT_THAT(message(1'000'000'000), HasSubstr("at most 67108864 decoded bytes are allowed"));
  // What the bytes could be is reported before it is decoded.
  CompressedParts parts = source.Compressed();
  const std::size_t count = 3'000'000;
  parts.views[0] = {EncodedVertices(std::string(12 * count, '\0'), 12), "ATTRIBUTES", 12, count};
  std::uint64_t told = 0;
  MeshReadOptions options;
  options.on_counts = [&](const MeshCounts& counts) -> Status {
    told = counts.other_bytes;
    if (counts.vertices == 0) return {};
    return Error{ErrorCode::kMemoryFull, "no"};
  };
  parts.accessors = "[" + Accessor(0, kFloatType, 1000, "VEC3") + ", " +
                    Accessor(1, kUintType, source.indices.size(), "SCALAR") + "]";
  EXPECT_EQ(ReadMesh(test::Bytes(parts.Glb()), options).error().code, ErrorCode::kMemoryFull);
  EXPECT_GE(told, 12 * count);
}

TEST(GltfMeshopt, DecodesTheLargestViewOfEachModeWithinTheTimeOfACancellation) {
  const auto time = [](const MeshoptForm& form, const std::string& encoded) {
    EXPECT_EQ(WhyNotMeshopt(form, encoded.size()), std::nullopt);
    std::vector<std::byte> decoded(form.Bytes());
    CancelPoll poll{CancelToken()};
    const std::chrono::nanoseconds begin = test::ThreadTime();
    EXPECT_TRUE(DecodeMeshopt(form, std::as_bytes(std::span(encoded)), decoded, &poll).ok());
    return test::ThreadTime() - begin;
  };
  const std::size_t count = kMaxMeshoptBytes / 16;
  // Random low bits: each number takes a byte of the encoded data.
  std::string raw(16 * count, '\0');
  std::mt19937_64 random(test::Seed() + 4);
  for (std::size_t i = 0; i < raw.size(); i += 4) raw[i] = static_cast<char>(random());
  EXPECT_LT(
      time({MeshoptMode::kAttributes, MeshoptFilter::kNone, 16, count}, EncodedVertices(raw, 16)),
      test::kPromptly);
  const std::size_t corners = kMaxMeshoptBytes / 4 / 3 * 3;
  std::vector<std::uint32_t> indices(corners);
  for (std::uint32_t& index : indices) index = static_cast<std::uint32_t>(random() % 1'000'000);
  EXPECT_LT(time({MeshoptMode::kTriangles, MeshoptFilter::kNone, 4, corners},
                 EncodedTriangles(indices, 1'000'000)),
            test::kPromptly);
  EXPECT_LT(time({MeshoptMode::kIndices, MeshoptFilter::kNone, 4, corners},
                 EncodedIndices(indices, 1'000'000)),
            test::kPromptly);
}

TEST(GltfMeshopt, EndsAtACancellation) {
  MeshReadOptions options;
  options.cancel = CancelToken::Cancellable();
  options.on_counts = [&](const MeshCounts& counts) -> Status {
    if (counts.triangles != 0) options.cancel.Cancel();
    return {};
  };
  const auto mesh = ReadMesh(test::Bytes(Source().Compressed().Glb()), options);
  ASSERT_FALSE(mesh.ok());
  EXPECT_EQ(mesh.error().code, ErrorCode::kCancelled);
}

TEST(GltfMeshopt, RefusesOrReadsAnyDamage) {
  const std::string good = Source().Compressed().Glb();
  const std::size_t binary = good.size() - 4000;
  std::mt19937_64 random(test::Seed() + 5);
  int read = 0;
  for (int i = 0; i < 2000; ++i) {
    std::string file = good;
    for (std::size_t n = 1 + random() % 3; n > 0; --n) {
      file[binary + random() % 4000] = static_cast<char>(random());
    }
    const auto mesh = ReadText(file);
    read += mesh.ok() ? 1 : 0;
    if (mesh.ok()) continue;
    EXPECT_EQ(mesh.error().code, ErrorCode::kInvalidMesh);
    EXPECT_FALSE(mesh.error().message.empty());
  }
  EXPECT_LT(read, 2000);
}

}  // namespace
}  // namespace kdray::core
