// SPDX-License-Identifier: Apache-2.0
// What core/io/gltf_reader.h needs of a glTF file's JSON: plain values, checked for their kind but
// not against each other or the buffers.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "core/base/cancel_poll.h"
#include "core/base/result.h"
#include "core/geometry/vec3.h"
#include "core/io/meshopt_decoder.h"

namespace kdray::core {

/// p -> x * p.x + y * p.y + z * p.z + offset.
struct GltfTransform {
  Vec3d x{1, 0, 0}, y{0, 1, 0}, z{0, 0, 1}, offset{0, 0, 0};

  Vec3d Turned(const Vec3d& p) const { return x * p.x + y * p.y + z * p.z; }
  Vec3d operator()(const Vec3d& p) const { return Turned(p) + offset; }
  /// First `inner`, then this.
  GltfTransform operator*(const GltfTransform& inner) const {
    return {Turned(inner.x), Turned(inner.y), Turned(inner.z), (*this)(inner.offset)};
  }
};

/// A range of elements of another list of the document.
struct GltfRange {
  std::uint32_t first = 0;
  std::uint32_t count = 0;
};

struct GltfBuffer {
  std::uint64_t bytes = 0;
  std::optional<std::string_view> data_uri;  ///< as it stands in the file, escapes included
  std::string other_uri;                     ///< of another file; empty with `data_uri`
};

/// Where the compressed bytes of a view are, and what they say of it (EXT_meshopt_compression).
struct GltfMeshopt {
  std::uint64_t buffer = 0;
  std::uint64_t offset = 0;
  std::uint64_t bytes = 0;
  MeshoptForm form;
};

struct GltfView {
  std::uint64_t buffer = 0;
  std::uint64_t offset = 0;
  std::uint64_t bytes = 0;
  std::uint64_t stride = 0;            ///< 0: elements touch
  std::optional<GltfMeshopt> meshopt;  ///< then nothing is read from `buffer` itself
};

enum class GltfType : std::uint16_t {
  kByte = 5120,
  kUnsignedByte = 5121,
  kShort = 5122,
  kUnsignedShort = 5123,
  kUnsignedInt = 5125,
  kFloat = 5126,
};

struct GltfSparse {
  std::uint64_t count = 0;
  std::uint64_t index_view = 0;
  std::uint64_t index_offset = 0;
  GltfType index_type = GltfType::kUnsignedInt;
  std::uint64_t value_view = 0;
  std::uint64_t value_offset = 0;
};

struct GltfAccessor {
  std::optional<std::uint64_t> view;
  std::uint64_t offset = 0;
  std::uint64_t count = 0;
  GltfType type = GltfType::kFloat;
  std::uint8_t components = 0;  ///< of an element; 0: a matrix, or a type that glTF does not have
  bool normalized = false;
  std::optional<GltfSparse> sparse;
};

enum class GltfMode : std::uint8_t {
  kPoints,
  kLines,
  kLineLoop,
  kLineStrip,
  kTriangles,
  kTriangleStrip,
  kTriangleFan
};

/// The numbers of its accessors.
struct GltfPrimitive {
  GltfMode mode = GltfMode::kTriangles;
  std::optional<std::uint64_t> position, normal, uv, color, indices;
};

struct GltfMesh {
  std::string name;
  GltfRange primitives;  ///< in GltfDocument::primitives
};

struct GltfNode {
  std::string name;
  std::optional<std::uint64_t> mesh;
  GltfRange children;  ///< in GltfDocument::links
  GltfTransform transform;
};

struct GltfDocument {
  std::vector<GltfBuffer> buffers;
  std::vector<GltfView> views;
  std::vector<GltfAccessor> accessors;
  std::vector<GltfPrimitive> primitives;
  std::vector<GltfMesh> meshes;
  std::vector<GltfNode> nodes;
  std::vector<std::uint64_t> links;  ///< numbers of nodes
  /// The nodes where the default scene begins: those of the scene that `scene` names, else of the
  /// first scene; in a file without scenes, all nodes without a parent.
  std::vector<std::uint64_t> roots;
  bool may_be_quantized = false;  ///< the file names KHR_mesh_quantization
};

/// Reads the JSON text of a glTF 2.0 file. What the reader has no use for is skipped, whatever it
/// is. Errors: kInvalidMesh, with the byte where the text is not JSON, else with the JSON pointer
/// of the value; kMeshTooLarge beyond kMaxGltfValues; those of the poll. `first_byte`: the text's
/// offset in its file. `on_bytes` is called once with the memory that reading and the result take,
/// before it is taken; its error ends the work. The document's views are into `text`.
///
/// Memory and time do not depend on long strings (buffers as data: URIs), which are not copied.
Result<GltfDocument> ReadGltfDocument(std::string_view text, std::uint64_t first_byte,
                                      CancelPoll* poll,
                                      const std::function<Status(std::uint64_t)>& on_bytes);

/// JSON values of a file at most. Scenes of millions of triangles have some thousands.
inline constexpr std::uint64_t kMaxGltfValues = std::uint64_t{1} << 22;
/// Nesting of JSON values at most.
inline constexpr std::size_t kMaxGltfDepth = 128;

/// kInvalidMesh at a place of the JSON: "/nodes/3/mesh: " and the cause.
Error AtPointer(std::string_view pointer, std::string_view cause);

}  // namespace kdray::core
