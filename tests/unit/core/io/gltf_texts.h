// SPDX-License-Identifier: Apache-2.0
// Small glTF files written inside the tests.
#pragma once

#include <cstdint>
#include <initializer_list>
#include <string>
#include <string_view>
#include <vector>

#include "tests/unit/core/io/mesh_texts.h"

namespace kdray::core {

inline std::string Base64(std::string_view bytes) {
  constexpr std::string_view kAlphabet =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    std::uint32_t bits = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      const unsigned char byte =
          i + k < bytes.size() ? static_cast<unsigned char>(bytes[i + k]) : 0;
      bits = bits << 8 | byte;
    }
    for (std::size_t k = 0; k < 4; ++k) {
      text += i + k <= bytes.size() ? kAlphabet[bits >> (18 - 6 * k) & 63] : '=';
    }
  }
  return text;
}

template <class T>
std::string RawList(std::initializer_list<T> values) {
  std::string bytes;
  for (const T value : values) bytes += Raw(value);
  return bytes;
}

/// A chunk of a GLB file, filled up to a multiple of four bytes.
inline std::string GlbChunk(std::string_view type, std::string content, char fill) {
  while (content.size() % 4 != 0) content += fill;
  return Raw(static_cast<std::uint32_t>(content.size())) + std::string(type) + content;
}

/// A GLB file of this JSON text and, if it is not empty, this BIN chunk.
inline std::string GlbOf(const std::string& json, const std::string& binary = {}) {
  std::string chunks = GlbChunk("JSON", json, ' ');
  if (!binary.empty()) chunks += GlbChunk(std::string_view("BIN\0", 4), binary, '\0');
  return "glTF" + Raw<std::uint32_t>(2) + Raw(static_cast<std::uint32_t>(12 + chunks.size())) +
         chunks;
}

/// A glTF file of one buffer, whose JSON values a test may replace. As it stands, it is the
/// triangle (0, 0, 0), (1, 0, 0), (0, 1, 0) with the indices 0, 1, 2, and a fourth vertex
/// (1, 1, 0).
struct GltfParts {
  std::string nodes = R"([{"mesh": 0}])";
  std::string scenes = R"("scene": 0, "scenes": [{"nodes": [0]}])";
  std::string meshes = R"([{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}])";
  std::string accessors =
      R"([{"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
          {"bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR"}])";
  std::string views = R"([{"buffer": 0, "byteLength": 48},
          {"buffer": 0, "byteOffset": 48, "byteLength": 6}])";
  std::string more;  // other members, each followed by a comma
  std::string binary =
      RawList<float>({0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0}) + RawList<std::uint16_t>({0, 1, 2});

  std::string Json(const std::string& buffers) const {
    return R"({"asset": {"version": "2.0"}, )" + more + scenes + R"(, "nodes": )" + nodes +
           R"(, "meshes": )" + meshes + R"(, "accessors": )" + accessors + R"(, "bufferViews": )" +
           views + R"(, "buffers": )" + buffers + "}";
  }
  std::string Text() const {
    return Json(R"([{"byteLength": )" + std::to_string(binary.size()) +
                R"(, "uri": "data:application/octet-stream;base64,)" + Base64(binary) + "\"}]");
  }
  std::string Glb() const {
    return GlbOf(Json(R"([{"byteLength": )" + std::to_string(binary.size()) + "}]"), binary);
  }
};

inline std::string GltfText() { return GltfParts().Text(); }

}  // namespace kdray::core
