// SPDX-License-Identifier: Apache-2.0
#include "clients/cpp/sample/mesh_writer.h"

#include <gtest/gtest.h>

#include <bit>
#include <cstdint>
#include <cstring>

namespace kdray::client {
namespace {

const SampleMesh kTriangle = {.vertices = {{0, 0, 0}, {0.1, 0, 0}, {0, -2.5e-7, 3}},
                              .triangles = {{0, 1, 2}}};

float FloatAt(const std::string& bytes, std::size_t offset) {
  std::uint32_t bits = 0;
  for (std::size_t i = 0; i < 4; ++i)
    bits |= static_cast<std::uint32_t>(static_cast<unsigned char>(bytes[offset + i])) << (8 * i);
  return std::bit_cast<float>(bits);
}

TEST(MeshWriter, WritesObjWithTheDigitsThatGiveTheSameFloatBack) {
  EXPECT_EQ(EncodeMesh(kTriangle, MeshFormat::kObj),
            "v 0 0 0\n"
            "v 0.1 0 0\n"
            "v 0 -2.5e-07 3\n"
            "f 1 2 3\n");
}

TEST(MeshWriter, WritesPlyWithAHeaderAndTwelveByteVertices) {
  const std::string bytes = EncodeMesh(kTriangle, MeshFormat::kPly);
  const std::string header =
      "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float "
      "y\nproperty float z\nelement face 1\nproperty list uchar uint vertex_indices\nend_header\n";
  ASSERT_EQ(bytes.substr(0, header.size()), header);
  ASSERT_EQ(bytes.size(), header.size() + 3 * 12 + 13);
  EXPECT_EQ(FloatAt(bytes, header.size() + 12), 0.1f);
  EXPECT_EQ(FloatAt(bytes, header.size() + 32), 3.0f);
  using namespace std::string_literals;
  EXPECT_EQ(bytes.substr(header.size() + 36), "\3\0\0\0\0\1\0\0\0\2\0\0\0"s);
}

TEST(MeshWriter, WritesStlWithUnitNormalsByTheRightHandRule) {
  const SampleMesh mesh = {.vertices = {{0, 0, 0}, {2, 0, 0}, {0, 5, 0}}, .triangles = {{0, 1, 2}}};
  const std::string bytes = EncodeMesh(mesh, MeshFormat::kStl);
  ASSERT_EQ(bytes.size(), 84u + 50u);
  EXPECT_NE(bytes.substr(0, 5), "solid");
  EXPECT_EQ(bytes.substr(80, 4), std::string("\1\0\0\0", 4));
  EXPECT_EQ(FloatAt(bytes, 84), 0.0f);
  EXPECT_EQ(FloatAt(bytes, 88), 0.0f);
  EXPECT_EQ(FloatAt(bytes, 92), 1.0f);
  EXPECT_EQ(FloatAt(bytes, 96 + 12), 2.0f);  // second corner
}

TEST(MeshWriter, TakesTheFormatFromTheEndingInAnyCase) {
  EXPECT_EQ(MeshFormatOf("a.obj"), MeshFormat::kObj);
  EXPECT_EQ(MeshFormatOf("dir.x/A.PLY"), MeshFormat::kPly);
  EXPECT_EQ(MeshFormatOf("b.c.Stl"), MeshFormat::kStl);
  for (const char* other : {"", "obj", "a.", "a.off", "a.obj ", "a.ply/b"}) {
    SCOPED_TRACE(other);
    EXPECT_FALSE(MeshFormatOf(other));
  }
}

}  // namespace
}  // namespace kdray::client
