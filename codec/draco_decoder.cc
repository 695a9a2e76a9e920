// SPDX-License-Identifier: Apache-2.0
#include "codec/draco_decoder.h"

#include <draco/compression/mesh/mesh_edgebreaker_decoder.h>
#include <draco/compression/mesh/mesh_sequential_decoder.h>
#include <draco/core/varint_decoding.h>

#include <bit>
#include <exception>
#include <new>
#include <string_view>
#include <type_traits>

namespace kdray::codec {
namespace {

static_assert(std::endian::native == std::endian::little);

std::string Refusal(const std::string& why) { return "e" + why; }

// The glTF component type of the library's data type; 0 for one that glTF does not have.
int ComponentType(draco::DataType type) {
  switch (type) {
    case draco::DT_INT8:
      return 5120;
    case draco::DT_UINT8:
      return 5121;
    case draco::DT_INT16:
      return 5122;
    case draco::DT_UINT16:
      return 5123;
    case draco::DT_UINT32:
      return 5125;
    case draco::DT_FLOAT32:
      return 5126;
    default:
      return 0;
  }
}

std::string CountsOf(std::uint64_t vertices, std::uint64_t triangles) {
  return std::to_string(vertices) + " vertices and " + std::to_string(triangles) + " triangles";
}

// The library's decoder, which is stopped twice to compare counts with those that the file claims:
// before it takes memory for triangles, and before it takes memory for their attributes.
template <class Decoder>
class CheckedDecoder : public Decoder {
 public:
  CheckedDecoder(const DracoClaims& claims, std::string* why) : claims_(claims), why_(why) {}

 private:
  static constexpr bool kIsEdgebreaker = std::is_same_v<Decoder, draco::MeshEdgebreakerDecoder>;

  bool InitializeDecoder() override {
    if (!Decoder::InitializeDecoder()) return false;
    draco::DecoderBuffer next = *this->buffer();
    std::uint32_t first = 0, second = 0;
    if (!draco::DecodeVarint(&first, &next) || !draco::DecodeVarint(&second, &next)) return false;
    // Edgebreaker counts vertices that attributes may split later.
    const std::uint32_t triangles = kIsEdgebreaker ? second : first;
    const std::uint32_t vertices = kIsEdgebreaker ? first : second;
    const bool fits =
        triangles == claims_.triangles && (kIsEdgebreaker || vertices == claims_.vertices);
    return fits || Refuse(vertices, triangles);
  }

  bool DecodeAllAttributes() override {
    const std::uint64_t vertices = this->point_cloud()->num_points();
    const std::uint64_t triangles = this->mesh()->num_faces();
    if (vertices != claims_.vertices || triangles != claims_.triangles) {
      return Refuse(vertices, triangles);
    }
    if (this->point_cloud()->num_attributes() > kMaxDracoAttributes) {
      *why_ = "the Draco data have " + std::to_string(this->point_cloud()->num_attributes()) +
              " attributes; at most " + std::to_string(kMaxDracoAttributes) + " are allowed";
      return false;
    }
    return Decoder::DecodeAllAttributes();
  }

  bool Refuse(std::uint64_t vertices, std::uint64_t triangles) {
    *why_ = "the Draco data have " + CountsOf(vertices, triangles) + "; the accessors say " +
            CountsOf(claims_.vertices, claims_.triangles);
    return false;
  }

  const DracoClaims& claims_;
  std::string* why_;
};

template <class Decoder>
bool Decode(std::span<const char> data, const DracoClaims& claims, draco::Mesh* mesh,
            std::string* why) {
  draco::DecoderBuffer buffer;
  buffer.Init(data.data(), data.size());
  const draco::DecoderOptions options;
  CheckedDecoder<Decoder> decoder(claims, why);
  return decoder.Decode(options, &buffer, mesh).ok();
}

// The bytes before the triangles: name, version, kind of geometry, method.
struct Header {
  bool is_edgebreaker = false;
};

std::string ReadHeader(std::span<const char> data, Header* header) {
  constexpr std::string_view kName = "DRACO";
  constexpr std::size_t kSize = 11;
  if (data.size() < kSize || std::string_view(data.data(), kName.size()) != kName) {
    return "the data do not begin as Draco data";
  }
  const auto byte = [&](std::size_t i) {
    return static_cast<int>(static_cast<unsigned char>(data[i]));
  };
  if (byte(5) != 2 || byte(6) != 2) {
    return "the Draco data have version " + std::to_string(byte(5)) + "." +
           std::to_string(byte(6)) + "; 2.2 is read";
  }
  if (byte(7) != draco::TRIANGULAR_MESH) return "the Draco data are not triangles";
  if (byte(8) != draco::MESH_SEQUENTIAL_ENCODING && byte(8) != draco::MESH_EDGEBREAKER_ENCODING) {
    return "the Draco data have the method " + std::to_string(byte(8)) + "; 0 and 1 exist";
  }
  header->is_edgebreaker = byte(8) == draco::MESH_EDGEBREAKER_ENCODING;
  return {};
}

// Why an attribute is not what is wanted; empty if it is.
std::string WhyNot(const draco::PointAttribute* attribute, const WantedAttribute& wanted) {
  const std::string name = "the Draco attribute " + std::to_string(wanted.id);
  if (attribute == nullptr) return name + " does not exist";
  if (attribute->num_components() != wanted.components) {
    return name + " has " + std::to_string(attribute->num_components()) +
           " components; the accessor says " + std::to_string(wanted.components);
  }
  if (ComponentType(attribute->data_type()) != wanted.component_type) {
    return name + " has components of type " +
           std::to_string(ComponentType(attribute->data_type())) + "; the accessor says " +
           std::to_string(wanted.component_type);
  }
  return {};
}

// Appends a value for each vertex. False if one is missing.
bool AppendValues(const draco::PointAttribute& attribute, std::uint64_t vertices,
                  std::string* answer) {
  const std::size_t size = static_cast<std::size_t>(draco::DataTypeLength(attribute.data_type())) *
                           static_cast<std::size_t>(attribute.num_components());
  const draco::DataBuffer* buffer = attribute.buffer();
  if (buffer == nullptr) return false;
  for (std::uint32_t i = 0; i < vertices; ++i) {
    const draco::AttributeValueIndex value = attribute.mapped_index(draco::PointIndex(i));
    if (value.value() >= attribute.size()) return false;
    const auto position = static_cast<std::uint64_t>(attribute.GetBytePos(value));
    if (position + size > buffer->data_size()) return false;
    answer->append(reinterpret_cast<const char*>(buffer->data()) + position, size);
  }
  return true;
}

std::string AnswerOf(const draco::Mesh& mesh, const DracoClaims& claims) {
  std::string answer = "m";
  answer.reserve(1 + 12 * claims.triangles);
  for (std::uint32_t i = 0; i < mesh.num_faces(); ++i) {
    for (const draco::PointIndex& corner : mesh.face(draco::FaceIndex(i))) {
      const std::uint32_t vertex = corner.value();
      if (vertex >= claims.vertices) {
        return Refusal("the Draco data name vertex " + std::to_string(vertex) + "; they have " +
                       std::to_string(claims.vertices) + ", counted from 0");
      }
      answer.append(reinterpret_cast<const char*>(&vertex), sizeof vertex);
    }
  }
  for (const WantedAttribute& wanted : claims.attributes) {
    const draco::PointAttribute* attribute = mesh.GetAttributeByUniqueId(wanted.id);
    std::string why = WhyNot(attribute, wanted);
    const std::size_t before = answer.size();
    answer += '\1';
    if (why.empty() && !AppendValues(*attribute, claims.vertices, &answer)) {
      why = "the Draco attribute " + std::to_string(wanted.id) + " lacks values";
    }
    if (why.empty()) continue;
    if (wanted.is_needed) return Refusal(why);
    answer.resize(before);
    answer += '\0';
  }
  return answer;
}

}  // namespace

std::string DecodeDraco(std::span<const char> data, const DracoClaims& claims) try {
  Header header;
  if (const std::string why = ReadHeader(data, &header); !why.empty()) return Refusal(why);
  draco::Mesh mesh;
  std::string why;
  const bool ok = header.is_edgebreaker
                      ? Decode<draco::MeshEdgebreakerDecoder>(data, claims, &mesh, &why)
                      : Decode<draco::MeshSequentialDecoder>(data, claims, &mesh, &why);
  if (!ok) return Refusal(why.empty() ? "the Draco data are damaged" : why);
  return AnswerOf(mesh, claims);
} catch (const std::bad_alloc&) {
  return "ethe Draco data need more memory than their triangles and vertices explain";
} catch (const std::exception&) {
  return "ethe Draco data are damaged";
}

}  // namespace kdray::codec
