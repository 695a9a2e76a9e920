// SPDX-License-Identifier: Apache-2.0
#include "tests/support/gltf_mesh.h"

#include <openssl/evp.h>

#include <algorithm>
#include <bit>
#include <cstdint>
#include <cstring>
#include <iterator>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace kdray::test {
namespace {

using core::MeshData;
using core::Vec3d;
using Json = nlohmann::json;
using ByteSpan = std::span<const std::byte>;

static_assert(std::endian::native == std::endian::little, "as the numbers in glTF files are");

[[noreturn]] void Fail(const std::string& why) { throw std::runtime_error("glTF: " + why); }

ByteSpan Part(ByteSpan bytes, std::size_t offset, std::size_t size) {
  if (offset > bytes.size() || size > bytes.size() - offset) Fail("a part lies beyond the end");
  return bytes.subspan(offset, size);
}

template <class T>
T Load(ByteSpan bytes, std::size_t offset) {
  T value;
  std::memcpy(&value, Part(bytes, offset, sizeof(T)).data(), sizeof(T));
  return value;
}

std::vector<std::byte> DecodeBase64(const std::string& text) {
  std::vector<std::byte> bytes(text.size() / 4 * 3);
  const int size = EVP_DecodeBlock(reinterpret_cast<unsigned char*>(bytes.data()),
                                   reinterpret_cast<const unsigned char*>(text.data()),
                                   static_cast<int>(text.size()));
  if (size < 0) Fail("a buffer is no base64");
  return bytes;  // with a zero for each '=', after the buffer's byteLength
}

/// p -> x * p.x + y * p.y + z * p.z + offset.
struct Affine {
  Vec3d x{1, 0, 0}, y{0, 1, 0}, z{0, 0, 1}, offset{0, 0, 0};

  Vec3d Turned(const Vec3d& p) const { return x * p.x + y * p.y + z * p.z; }
  Vec3d operator()(const Vec3d& p) const { return Turned(p) + offset; }
  /// First `inner`, then this.
  Affine operator*(const Affine& inner) const {
    return {Turned(inner.x), Turned(inner.y), Turned(inner.z), (*this)(inner.offset)};
  }
};

Vec3d ReadVec3(const Json& numbers) { return {numbers.at(0), numbers.at(1), numbers.at(2)}; }

Affine LocalTransform(const Json& node) {
  if (const auto matrix = node.find("matrix"); matrix != node.end()) {
    const auto column = [&](std::size_t i) -> Vec3d {
      return {matrix->at(4 * i), matrix->at(4 * i + 1), matrix->at(4 * i + 2)};
    };
    return {column(0), column(1), column(2), column(3)};
  }
  Affine transform;
  if (const auto r = node.find("rotation"); r != node.end()) {
    const double x = r->at(0), y = r->at(1), z = r->at(2), w = r->at(3);
    transform.x = {1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)};
    transform.y = {2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)};
    transform.z = {2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)};
  }
  if (const auto scale = node.find("scale"); scale != node.end()) {
    const Vec3d s = ReadVec3(*scale);
    transform.x = transform.x * s.x;
    transform.y = transform.y * s.y;
    transform.z = transform.z * s.z;
  }
  if (const auto t = node.find("translation"); t != node.end()) transform.offset = ReadVec3(*t);
  return transform;
}

class GltfFile {
 public:
  explicit GltfFile(ByteSpan bytes) {
    const bool is_binary = bytes.size() >= 4 && std::memcmp(bytes.data(), "glTF", 4) == 0;
    ByteSpan text = bytes;
    ByteSpan binary;
    if (is_binary) {
      if (Load<std::uint32_t>(bytes, 4) != 2) Fail("not version 2");
      // Chunks: their size, what they are, and their bytes. The JSON text comes first.
      const std::size_t text_size = Load<std::uint32_t>(bytes, 12);
      text = Part(bytes, 20, text_size);
      if (const std::size_t next = 20 + text_size; next < bytes.size()) {
        binary = Part(bytes, next + 8, Load<std::uint32_t>(bytes, next));
      }
    }
    const auto* first = reinterpret_cast<const char*>(text.data());
    json_ = Json::parse(first, first + text.size());
    if (json_.contains("extensionsRequired")) Fail("it needs extensions");
    for (const Json& buffer : json_.value("buffers", Json::array())) {
      const std::string uri = buffer.value("uri", "");
      const std::size_t comma = uri.find(";base64,");
      if (uri.empty()) {
        buffers_.emplace_back(binary.begin(), binary.end());
      } else if (uri.starts_with("data:") && comma != std::string::npos) {
        buffers_.push_back(DecodeBase64(uri.substr(comma + 8)));
      } else {
        Fail("a buffer is in another file");
      }
      const std::size_t size = buffer.at("byteLength");
      if (size > buffers_.back().size()) Fail("a buffer is too short");
      buffers_.back().resize(size);
    }
  }

  MeshData DefaultScene() const {
    MeshData mesh;
    const Json& scene = json_.at("scenes").at(json_.value("scene", std::size_t{0}));
    for (const std::size_t node : scene.value("nodes", Json::array())) {
      AddNode(node, Affine{}, 0, &mesh);
    }
    return mesh;
  }

 private:
  void AddNode(std::size_t index, const Affine& parent, std::size_t depth, MeshData* mesh) const {
    const Json& nodes = json_.at("nodes");
    if (depth > nodes.size()) Fail("a node is its own descendant");
    const Json& node = nodes.at(index);
    const Affine transform = parent * LocalTransform(node);
    if (const auto shown = node.find("mesh"); shown != node.end()) {
      const Json& primitives = json_.at("meshes").at(shown->get<std::size_t>()).at("primitives");
      for (const Json& primitive : primitives) AddPrimitive(primitive, transform, mesh);
    }
    for (const std::size_t child : node.value("children", Json::array())) {
      AddNode(child, transform, depth + 1, mesh);
    }
  }

  void AddPrimitive(const Json& primitive, const Affine& transform, MeshData* mesh) const {
    if (primitive.value("mode", 4) != 4) Fail("a primitive is no list of triangles");
    const std::size_t first = mesh->vertices.size();
    const std::vector<Vec3d> positions = ReadPositions(primitive.at("attributes").at("POSITION"));
    std::transform(positions.begin(), positions.end(), std::back_inserter(mesh->vertices),
                   transform);
    std::vector<std::uint32_t> corners;
    if (const auto indices = primitive.find("indices"); indices != primitive.end()) {
      const Json& accessor = json_.at("accessors").at(indices->get<std::size_t>());
      corners = ReadIndices(accessor, accessor.at("componentType"), accessor.at("count"));
    } else {
      for (std::uint32_t i = 0; i < positions.size(); ++i) corners.push_back(i);
    }
    for (std::size_t i = 0; i + 2 < corners.size(); i += 3) {
      core::TriangleIndices triangle;
      for (std::size_t k = 0; k < 3; ++k) {
        if (corners[i + k] >= positions.size()) Fail("an index has no vertex");
        triangle[k] = static_cast<std::uint32_t>(first + corners[i + k]);
      }
      mesh->triangles.push_back(triangle);
    }
  }

  /// Bytes from the first element on, and the distance between elements. `place` is an accessor or
  /// a part of a sparse one.
  std::pair<ByteSpan, std::size_t> Elements(const Json& place, std::size_t element_size) const {
    const Json& view = json_.at("bufferViews").at(place.at("bufferView").get<std::size_t>());
    const ByteSpan bytes = Part(buffers_.at(view.at("buffer").get<std::size_t>()),
                                view.value("byteOffset", std::size_t{0}), view.at("byteLength"));
    const std::size_t offset = place.value("byteOffset", std::size_t{0});
    if (offset > bytes.size()) Fail("an accessor begins beyond its view");
    return {bytes.subspan(offset), view.value("byteStride", element_size)};
  }

  std::vector<Vec3d> ReadVectors(const Json& place, std::size_t count) const {
    const auto [bytes, stride] = Elements(place, 3 * sizeof(float));
    std::vector<Vec3d> vectors;
    for (std::size_t i = 0; i < count; ++i) {
      const auto number = [&, &from = bytes, at = i * stride](std::size_t k) {
        return static_cast<double>(Load<float>(from, at + k * sizeof(float)));
      };
      vectors.push_back({number(0), number(1), number(2)});
    }
    return vectors;
  }

  std::vector<Vec3d> ReadPositions(std::size_t index) const {
    const Json& accessor = json_.at("accessors").at(index);
    if (accessor.at("componentType") != 5126 || accessor.at("type") != "VEC3") {
      Fail("positions are no floats");
    }
    const std::size_t count = accessor.at("count");
    // Without a view all are zero, except those that a sparse accessor replaces.
    std::vector<Vec3d> positions =
        accessor.contains("bufferView") ? ReadVectors(accessor, count) : std::vector<Vec3d>(count);
    if (const auto sparse = accessor.find("sparse"); sparse != accessor.end()) {
      const std::size_t replaced = sparse->at("count");
      const Json& indices = sparse->at("indices");
      const auto which = ReadIndices(indices, indices.at("componentType"), replaced);
      const std::vector<Vec3d> values = ReadVectors(sparse->at("values"), replaced);
      for (std::size_t i = 0; i < replaced; ++i) positions.at(which[i]) = values[i];
    }
    return positions;
  }

  std::vector<std::uint32_t> ReadIndices(const Json& place, int component_type,
                                         std::size_t count) const {
    const std::size_t size = component_type == 5121   ? 1
                             : component_type == 5123 ? 2
                             : component_type == 5125 ? 4
                                                      : 0;
    if (size == 0) Fail("indices are no unsigned integers");
    const auto [bytes, stride] = Elements(place, size);
    std::vector<std::uint32_t> indices(count);
    for (std::size_t i = 0; i < count; ++i) {
      std::memcpy(&indices[i], Part(bytes, i * stride, size).data(), size);
    }
    return indices;
  }

  Json json_;
  std::vector<std::vector<std::byte>> buffers_;
};

}  // namespace

MeshData ReadGltf(ByteSpan bytes) { return GltfFile(bytes).DefaultScene(); }

}  // namespace kdray::test
