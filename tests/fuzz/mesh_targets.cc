// SPDX-License-Identifier: Apache-2.0
// Mesh files of every format, and what they say besides triangles.
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <string>

#include "core/io/mesh_attributes.h"
#include "core/io/mesh_reader.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/support/obj_text.h"
#include "tests/support/off_text.h"
#include "tests/support/shapes.h"

namespace kdray::fuzz {
namespace {

// A small file may claim much. More than this is refused, as a small --memory-limit would.
constexpr std::uint64_t kMostMemory = std::uint64_t{64} << 20;

core::MeshReadOptions LimitedOptions() {
  core::MeshReadOptions options;
  options.on_counts = [](const core::MeshCounts& counts) -> core::Status {
    if (counts.ReadBytes() <= kMostMemory) return {};
    return core::Error{core::ErrorCode::kMeshTooLarge, "too large for the fuzzer"};
  };
  return options;
}

void CheckMesh(const core::MeshData& mesh) {
  Require(!mesh.triangles.empty(), "a mesh has a triangle");
  for (const core::TriangleIndices& triangle : mesh.triangles) {
    for (const std::uint32_t corner : triangle) {
      Require(corner < mesh.vertices.size(), "an index names a vertex");
      Require(core::IsFinite(mesh.vertices[corner]), "a vertex that is used is finite");
    }
  }
}

bool FuzzMesh(std::span<const std::byte> input) {
  const core::Result<core::MeshData> mesh = core::ReadMesh(input, LimitedOptions());
  if (!mesh.ok()) {
    Require(!mesh.error().message.empty(), "an error says what is wrong");
    return false;
  }
  CheckMesh(*mesh);
  // What ReadMesh accepts becomes a mesh, or is refused by it with a reason.
  const auto made = core::TriangleMesh::Create(*mesh);
  Require(made.ok() || !made.error().message.empty(), "an error says what is wrong");
  return made.ok();
}

bool FuzzAttributes(std::span<const std::byte> input) {
  using enum core::AttributeKind;
  const auto mesh = core::ReadMesh(input, LimitedOptions());
  const auto attributes =
      core::ReadAttributes(input, {kUv, kShadingNormal, kColor, kGroup, kEdges}, LimitedOptions());
  if (!mesh.ok() || !attributes.ok()) return false;
  const auto groups = static_cast<std::int32_t>(attributes->group_names().size());
  for (std::size_t i = 0; i < mesh->triangles.size(); ++i) {
    const auto id = static_cast<core::PrimitiveId>(i);
    const std::array<double, 2> uv = attributes->Uv(id, 0.25, 0.5);
    Require(std::isfinite(uv[0]) == std::isfinite(uv[1]) && !std::isinf(uv[0]),
            "texture coordinates are finite or NaN");
    const core::Vec3d normal = attributes->ShadingNormal(id, 0.25, 0.5);
    Require(std::isnan(normal.x) || std::abs(core::Dot(normal, normal) - 1) < 1e-6,
            "a normal is of unit length or NaN");
    const core::Vec3d color = attributes->Color(id, 0.25, 0.5);
    Require(std::isnan(color.x) || (color.x >= 0 && color.x <= 1 && color.y >= 0 && color.y <= 1 &&
                                    color.z >= 0 && color.z <= 1),
            "a colour is in 0..1 or NaN");
    Require(attributes->Group(id) >= -1 && attributes->Group(id) < groups, "a group has a name");
    Require(attributes->Edges(id) <= core::MeshAttributes::kAllEdges, "a triangle has three edges");
  }
  for (const std::string& name : attributes->group_names()) {
    Require(name.size() <= 128, "a group's name has at most 128 bytes");
  }
  return true;
}

std::string Word(std::size_t value) {
  const auto bytes = std::bit_cast<std::array<char, 4>>(static_cast<std::uint32_t>(value));
  return {bytes.begin(), bytes.end()};
}

std::string AsciiStl() {
  return "solid s\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n"
         "endloop\nendfacet\nendsolid s\n";
}

std::string BinaryStl() {
  std::string file(84, '\0');
  file[80] = 1;
  for (const float number : {0.f, 0.f, 1.f, 0.f, 0.f, 0.f, 1.f, 0.f, 0.f, 0.f, 1.f, 0.f}) {
    file += Word(std::bit_cast<std::uint32_t>(number));
  }
  return file + std::string(2, '\0');
}

std::string AsciiPly() {
  return "ply\nformat ascii 1.0\ncomment c\nelement vertex 4\nproperty float x\nproperty float y\n"
         "property float z\nproperty float nx\nproperty float ny\nproperty float nz\n"
         "property uchar red\nproperty uchar green\nproperty uchar blue\nproperty float s\n"
         "property float t\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
         "0 0 0 0 0 1 255 0 0 0 0\n1 0 0 0 0 1 255 0 0 1 0\n1 1 0 0 0 1 255 0 0 1 1\n"
         "0 1 0 0 0 1 255 0 0 0 1\n4 0 1 2 3\n";
}

std::string BinaryPly() {
  std::string file =
      "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\n"
      "property float y\nproperty float z\nelement face 1\n"
      "property list uchar uint vertex_indices\nend_header\n";
  for (const float number : {0.f, 0.f, 0.f, 1.f, 0.f, 0.f, 0.f, 1.f, 0.f}) {
    file += Word(std::bit_cast<std::uint32_t>(number));
  }
  file += '\3';
  return file + Word(0) + Word(1) + Word(2);
}

// One triangle; `uri` is the buffer's, with a comma after it, or empty in a GLB file.
std::string GltfJson(const std::string& uri) {
  return R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],)"
         R"("nodes":[{"mesh":0,"translation":[1,2,3],"rotation":[0,0,0,1],"scale":[1,1,1]}],)"
         R"("meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1,"mode":4}]}],)"
         R"("accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"},)"
         R"({"bufferView":1,"componentType":5123,"count":3,"type":"SCALAR"}],)"
         R"("bufferViews":[{"buffer":0,"byteLength":36},)"
         R"({"buffer":0,"byteOffset":36,"byteLength":6}],)"
         R"("buffers":[{)" +
         uri + R"("byteLength":44}]})";
}

std::string Gltf() {
  // Three corners as floats, and the indices 0 1 2 as shorts.
  return GltfJson(R"("uri":"data:application/octet-stream;base64,)"
                  R"(AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAAAAABAAIAAAA=",)");
}

std::string Glb() {
  std::string json = GltfJson("");
  json.resize((json.size() + 3) / 4 * 4, ' ');
  std::string buffer;
  for (const float number : {0.f, 0.f, 0.f, 1.f, 0.f, 0.f, 0.f, 1.f, 0.f}) {
    buffer += Word(std::bit_cast<std::uint32_t>(number));
  }
  buffer += Word(1u << 16) + Word(2);
  const std::string chunks =
      Word(json.size()) + "JSON" + json + Word(buffer.size()) + std::string("BIN\0", 4) + buffer;
  return "glTF" + Word(2) + Word(chunks.size() + 12) + chunks;
}

std::vector<Bytes> MeshSeeds() {
  const core::MeshData cube = test::Cube({0, 0, 0}, 1);
  return {
      ToBytes(test::ObjText(cube)),
      ToBytes("mtllib m.mtl\no one\nv 0 0 0 1 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 1\n"
              "vn 0 0 1\ng a\nusemtl b\ns off\nf 1/1/1 2/2/1 3/1/1 4/2/1\nf -4//1 -3//1 -2//1\n"
              "f 1/1 2/2 \\\n3/1\n"),
      test::OffBytes(cube),
      ToBytes("COFF\n3 1 0\n0 0 0 1 0 0 1\n1 0 0 0 1 0 1\n0 1 0 0 0 1 1\n3 0 1 2 0.5 0.5 0.5\n"),
      ToBytes(AsciiStl()),
      ToBytes(BinaryStl()),
      ToBytes(AsciiPly()),
      ToBytes(BinaryPly()),
      ToBytes(Glb()),
      ToBytes(Gltf())};
}

const FuzzTarget kTargets[] = {{"mesh", FuzzMesh, MeshSeeds},
                               {"attributes", FuzzAttributes, MeshSeeds}};

}  // namespace

std::span<const FuzzTarget> MeshTargets() { return kTargets; }

}  // namespace kdray::fuzz
