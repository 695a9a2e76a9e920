// SPDX-License-Identifier: Apache-2.0
// Small mesh files written inside the tests.
#pragma once

#include <gtest/gtest.h>

#include <bit>
#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>

#include "core/io/mesh_reader.h"
#include "tests/support/mesh_files.h"

namespace kdray::core {

inline Result<MeshData> ReadText(std::string_view text) { return ReadMesh(test::Bytes(text)); }

/// The mesh of a file that must be good.
inline MeshData MustRead(std::string_view text) {
  Result<MeshData> mesh = ReadText(text);
  if (mesh.ok()) return *std::move(mesh);
  ADD_FAILURE() << mesh.error().message;
  return {};
}

/// The error of a file that must be refused.
inline Error MustRefuse(std::string_view text) {
  const Result<MeshData> mesh = ReadText(text);
  if (!mesh.ok()) return mesh.error();
  ADD_FAILURE() << "read " << mesh->triangles.size() << " triangles";
  return {};
}

inline void ExpectInvalidAtLine(std::string_view text, std::uint64_t line,
                                std::string_view message) {
  const Error error = MustRefuse(text);
  EXPECT_EQ(error.code, ErrorCode::kInvalidMesh);
  EXPECT_EQ(error.message, message) << text;
  EXPECT_EQ(error.line, line) << text;
  EXPECT_FALSE(error.byte.has_value());
}

inline void ExpectInvalidAtByte(std::string_view text, std::uint64_t byte,
                                std::string_view message) {
  const Error error = MustRefuse(text);
  EXPECT_EQ(error.code, ErrorCode::kInvalidMesh);
  EXPECT_EQ(error.message, message);
  EXPECT_EQ(error.byte, byte);
  EXPECT_FALSE(error.line.has_value());
}

/// The bytes of a number, in the order asked for.
template <class T>
std::string Raw(T value, std::endian order = std::endian::little) {
  std::string bytes(sizeof(T), '\0');
  std::memcpy(bytes.data(), &value, sizeof(T));
  if (order != std::endian::native) bytes.assign(bytes.rbegin(), bytes.rend());
  return bytes;
}

}  // namespace kdray::core
