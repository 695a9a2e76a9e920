// SPDX-License-Identifier: Apache-2.0
// Compares the expected memory of a mesh file with its real peak.
#include <gtest/gtest.h>

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <optional>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "core/library/parse_mesh.h"
#include "tests/support/allocation_count.h"
#include "tests/support/mesh_files.h"
#include "tests/support/obj_text.h"
#include "tests/support/off_text.h"
#include "tests/support/seed.h"
#include "tests/support/shapes.h"
#include "tests/unit/core/io/gltf_texts.h"

namespace kdray::core {
namespace {

constexpr std::size_t kBytes = std::size_t{6} << 20;

struct Case {
  std::string name;
  std::string file;
};

void PutFloats(std::string* file, int count, std::mt19937_64& random) {
  for (int i = 0; i < count; ++i) {
    const float value = static_cast<float>(random() % 100'000) / 1000;
    file->append(reinterpret_cast<const char*>(&value), sizeof value);
  }
}

std::string PlyHeader(std::size_t vertices, std::size_t faces, const std::string& list,
                      const std::string& number = "float") {
  std::string header = "ply\nformat binary_little_endian 1.0\nelement vertex ";
  header += std::to_string(vertices);
  for (const char* axis : {"x", "y", "z"}) header += "\nproperty " + number + " " + axis;
  header += "\nelement face " + std::to_string(faces) + "\nproperty list " + list +
            " vertex_indices\nend_header\n";
  return header;
}

// One face with an index of one byte for each corner.
std::string OneLargePolygon() {
  std::mt19937_64 random = test::RandomEngine(1);
  std::string file = PlyHeader(256, 1, "uint uchar");
  PutFloats(&file, 3 * 256, random);
  const auto corners = static_cast<std::uint32_t>(kBytes);
  file.append(reinterpret_cast<const char*>(&corners), 4);
  file.append(kBytes, '\1');
  return file;
}

// Triangles of four bytes each.
std::string SmallFaces() {
  std::mt19937_64 random = test::RandomEngine(2);
  std::string file = PlyHeader(256, kBytes / 4, "uchar uchar");
  PutFloats(&file, 3 * 256, random);
  for (std::size_t i = 0; i < kBytes / 4; ++i) {
    const unsigned a = random() % 256;
    const unsigned b = (a + 1 + random() % 100) % 256;
    const unsigned c = (b + 1 + random() % 100) % 256;
    for (const unsigned byte : {3u, a, b, c}) file += static_cast<char>(byte);
  }
  return file;
}

// Vertices of three bytes, and one face.
std::string SmallVertices() {
  std::string file = PlyHeader(kBytes / 3, 1, "uchar uchar", "uchar");
  for (std::size_t i = 0; i < kBytes / 3 * 3; ++i) file += static_cast<char>(i * 7919 >> 3);
  file += std::string("\3\0\1\2", 4);
  return file;
}

// A star of one vertex with very many edges, whose triangles are all different.
std::string Fan() {
  const std::size_t spokes = kBytes / 40;
  std::string file = "v 0 0 0\n";
  for (std::size_t i = 0; i < spokes; ++i) {
    file += "v " + std::to_string(i + 1) + " " + std::to_string(i % 7 + 1) + " " +
            std::to_string(i % 5) + "\n";
  }
  for (std::size_t i = 2; i <= spokes; ++i) {
    file += "f 1 " + std::to_string(i) + " " + std::to_string(i + 1) + "\n";
  }
  return file;
}

std::string Repeat(const std::string& head, const std::string& statement, const std::string& tail) {
  std::string file = head;
  while (file.size() < kBytes) file += statement;
  return file + tail;
}

std::string BinaryStl() {
  std::mt19937_64 random = test::RandomEngine(3);
  const auto count = static_cast<std::uint32_t>(kBytes / 50);
  std::string file(80, ' ');
  file.append(reinterpret_cast<const char*>(&count), 4);
  for (std::uint32_t i = 0; i < count; ++i) {
    PutFloats(&file, 12, random);
    file.append(2, '\0');
  }
  return file;
}

std::string AsciiStl(const char* separator) {
  std::string file = "solid s\n";
  for (int i = 0; file.size() < kBytes; ++i) {
    file += std::string("facet normal 0 0 1") + separator + "outer loop" + separator;
    for (int corner = 0; corner < 3; ++corner) {
      file += "vertex " + std::to_string(i % 1000) + " " + std::to_string(i / 1000 + corner % 2) +
              " " + std::to_string(corner) + separator;
    }
    file += std::string("endloop") + separator + "endfacet\n";
  }
  return file + "endsolid s\n";
}

std::string AsciiPly(const MeshData& data) {
  std::string file = "ply\nformat ascii 1.0\nelement vertex " +
                     std::to_string(data.vertices.size()) +
                     "\nproperty double x\nproperty double y\nproperty double z\nelement face " +
                     std::to_string(data.triangles.size()) +
                     "\nproperty list uchar int vertex_indices\nend_header\n";
  for (const Vec3d& p : data.vertices) {
    file += std::to_string(p.x) + " " + std::to_string(p.y) + " " + std::to_string(p.z) + "\n";
  }
  for (const TriangleIndices& t : data.triangles) {
    file += "3 " + std::to_string(t[0]) + " " + std::to_string(t[1]) + " " + std::to_string(t[2]) +
            "\n";
  }
  return file;
}

// One mesh with 32-bit indices, in a BIN chunk.
std::string Glb(const MeshData& data) {
  GltfParts parts;
  parts.binary.clear();
  for (const Vec3d& p : data.vertices) {
    for (int axis = 0; axis < 3; ++axis) parts.binary += Raw(static_cast<float>(p[axis]));
  }
  const std::string positions = std::to_string(parts.binary.size());
  for (const TriangleIndices& t : data.triangles) {
    for (const std::uint32_t index : t) parts.binary += Raw(index);
  }
  const std::string corners = std::to_string(3 * data.triangles.size());
  parts.accessors = R"([{"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": )" +
                    std::to_string(data.vertices.size()) +
                    R"(}, {"bufferView": 1, "componentType": 5125, "type": "SCALAR", "count": )" +
                    corners + "}]";
  parts.views = R"([{"buffer": 0, "byteLength": )" + positions +
                R"(}, {"buffer": 0, "byteOffset": )" + positions + R"(, "byteLength": )" +
                std::to_string(12 * data.triangles.size()) + "}]";
  return parts.Glb();
}

std::string OffText(const MeshData& data) {
  const std::vector<std::byte> bytes = test::OffBytes(data);
  return std::string(reinterpret_cast<const char*>(bytes.data()), bytes.size());
}

std::vector<Case> Cases() {
  const MeshData sphere = test::UvSphere({0.1, 0.2, 0.3}, 1, 250, 250);
  const std::string triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
  std::vector<Case> cases = {
      {"PLY, one face of many corners", OneLargePolygon()},
      {"PLY, faces of four bytes", SmallFaces()},
      {"PLY, vertices of three bytes", SmallVertices()},
      {"PLY in text", AsciiPly(sphere)},
      {"OBJ, a sphere", test::ObjText(sphere)},
      {"OBJ, one triangle again and again", Repeat(triangle, "f 1 2 3\n", "")},
      {"OBJ, f 1 1 1 ...", Repeat(triangle + "f", " 1", "\nf 1 2 3\n")},
      {"OBJ, nearly vertices alone", Repeat(triangle, "v 1 2 3\n", "f 1 2 3\n")},
      {"OBJ, vertices with long numbers", Repeat(triangle, "v 0.1 0.2 0.3\n", "f 1 2 4\n")},
      {"OBJ, a fan", Fan()},
      {"OBJ, nearly comments alone", Repeat(triangle, "# nothing\n", "f 1 2 3\n")},
      {"STL, binary", BinaryStl()},
      {"STL in text", AsciiStl("\n")},
      {"STL in text on few lines", AsciiStl(" ")},
      {"OFF, a sphere", OffText(sphere)},
      {"GLB, a sphere", Glb(sphere)},
  };
  std::string off = "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n";
  const std::size_t corners = kBytes / 2;
  off += std::to_string(corners + 3);
  for (std::size_t i = 0; i < corners; ++i) off += " 0";
  cases.push_back({"OFF, one face of many corners", off + " 0 1 2\n"});
  return cases;
}

TEST(ParseMemory, IsWhatTheCountsSayForEveryFormatAndShape) {
  for (const Case& c : Cases()) {
    SCOPED_TRACE(c.name);
    std::vector<std::byte> bytes = test::Bytes(c.file);
    const std::size_t file_bytes = bytes.size();
    std::uint64_t expected = LeastParseBytes(file_bytes);
    const test::AllocationPeak memory;
    const auto parsed =
        ParseMesh(std::move(bytes), CancelToken(), [&](const MeshCounts& counts) -> Status {
          // Nothing is taken before it is told.
          EXPECT_LE(memory.bytes() + file_bytes, expected);
          expected = ParsePeakBytes(file_bytes, counts);
          return {};
        });
    const std::uint64_t peak = file_bytes + memory.bytes();
    ASSERT_TRUE(parsed.ok()) << parsed.error().message;
    EXPECT_LE(peak, expected);
    EXPECT_GE(static_cast<double>(peak), static_cast<double>(expected) / 1.5);
    EXPECT_LE(parsed->facts.memory_bytes, expected);
  }
}

TEST(ParseMemory, IsNotTakenWhenTheCountsAreRefused) {
  for (const Case& c : Cases()) {
    SCOPED_TRACE(c.name);
    std::vector<std::byte> bytes = test::Bytes(c.file);
    const test::AllocationPeak memory;
    const auto parsed =
        ParseMesh(std::move(bytes), CancelToken(), [&](const MeshCounts&) -> Status {
          return Error{ErrorCode::kMemoryFull, "no memory"};
        });
    ASSERT_FALSE(parsed.ok());
    EXPECT_EQ(parsed.error().code, ErrorCode::kMemoryFull);
    EXPECT_LE(memory.bytes(), 64u << 10);
  }
}

}  // namespace
}  // namespace kdray::core
