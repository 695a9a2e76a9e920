// SPDX-License-Identifier: Apache-2.0
// What a mesh file says about its surface besides triangles: texture coordinates, normals, colours,
// groups, and which edges of the triangles are edges of the file's faces. Read from the file's
// bytes when first needed, never at the upload. core/io/attribute_sink.h collects them from the
// readers.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "core/base/result.h"
#include "core/geometry/hit.h"
#include "core/geometry/triangle_mesh.h"
#include "core/geometry/vec3.h"
#include "core/io/mesh_reader.h"

namespace kdray::core {

enum class AttributeKind : std::uint8_t {
  kUv,             ///< OBJ `vt`, PLY `s t`, `u v` or `texture_u texture_v`, glTF TEXCOORD_0
  kShadingNormal,  ///< OBJ `vn`, PLY `nx ny nz`, glTF NORMAL
  kColor,          ///< of vertices, else of faces
  kGroup,          ///< OBJ `o`, else `g`, else `usemtl`; solids of ASCII STL; primitives of glTF
  kEdges,          ///< of the file's faces
};
constexpr std::string_view Name(AttributeKind kind) {
  switch (kind) {
    case AttributeKind::kUv:
      return "uv";
    case AttributeKind::kShadingNormal:
      return "shading_normal";
    case AttributeKind::kColor:
      return "color";
    case AttributeKind::kGroup:
      return "group";
    case AttributeKind::kEdges:
      return "edges";
  }
  return {};
}

/// A set of kinds.
class AttributeKinds {
 public:
  constexpr AttributeKinds() = default;
  constexpr AttributeKinds(std::initializer_list<AttributeKind> kinds) {
    for (const AttributeKind kind : kinds) Add(kind);
  }

  constexpr void Add(AttributeKind kind) {
    bits_ = static_cast<std::uint8_t>(bits_ | 1u << static_cast<unsigned>(kind));
  }
  constexpr bool Has(AttributeKind kind) const {
    return (bits_ >> static_cast<unsigned>(kind) & 1u) != 0;
  }
  constexpr bool empty() const { return bits_ == 0; }
  /// Whether all of `others` are in this set.
  constexpr bool Contains(AttributeKinds others) const { return (others.bits_ & ~bits_) == 0; }
  /// The kinds of both sets.
  friend constexpr AttributeKinds operator|(AttributeKinds a, AttributeKinds b) {
    AttributeKinds both;
    both.bits_ = static_cast<std::uint8_t>(a.bits_ | b.bits_);
    return both;
  }
  friend constexpr bool operator==(AttributeKinds, AttributeKinds) = default;

 private:
  std::uint8_t bits_ = 0;
};

/// The attributes of a mesh by triangle number. Immutable, so safe from many threads at once. A
/// kind that was not read answers as if the file did not have it. `u` and `v` weigh a triangle's
/// second and third corner, as in a hit. Every id must be below the mesh's triangle count.
class MeshAttributes {
 public:
  /// Number of groups at most; faces of later groups have none.
  static constexpr std::size_t kMaxGroups = 4096;
  static constexpr std::int32_t kNoGroup = -1;
  static constexpr std::uint8_t kAllEdges = 7;

  AttributeKinds kinds() const { return kinds_; }  ///< those that were read
  /// Whether the file has this kind anywhere. For kEdges: whether some triangle has an edge inside
  /// a face.
  bool has(AttributeKind kind) const;

  /// Texture coordinates, interpolated. NaN where the file has none, and where one is not finite.
  std::array<double, 2> Uv(PrimitiveId id, double u, double v) const;
  /// The interpolated normals of the corners, of unit length. The side is that of the file; it is
  /// not turned towards a ray. NaN where the file has none, where one is zero or not finite, and
  /// where they cancel.
  Vec3d ShadingNormal(PrimitiveId id, double u, double v) const;
  /// Linear red, green, blue in 0..1: that of the vertices, interpolated, or if the file colours no
  /// vertex, that of the face. Colours are interpolated as the file encodes them: glTF's are
  /// linear, all others sRGB. NaN where the file has none.
  Vec3d Color(PrimitiveId id, double u, double v) const;
  /// Index into group_names(), or kNoGroup.
  std::int32_t Group(PrimitiveId id) const {
    return groups_.empty() ? kNoGroup : std::int32_t{groups_[id]};
  }
  /// Bit k is set if the triangle's side from corner k to corner (k + 1) % 3 is an edge of the
  /// file's face; the others are diagonals of a polygon.
  std::uint8_t Edges(PrimitiveId id) const { return edges_.empty() ? kAllEdges : edges_[id]; }

  /// The names of groups with triangles, in the order of their first. Valid UTF-8, at most 128
  /// bytes each.
  std::span<const std::string> group_names() const { return group_names_; }

  /// Memory.
  std::uint64_t bytes() const;

 private:
  friend class AttributeSink;

  // Index of a corner without a value.
  static constexpr std::uint32_t kNoValue = 0xffffffff;

  AttributeKinds kinds_;
  // For each triangle the places of its corners in a table. A table without places of its own has
  // a value for each vertex.
  std::vector<TriangleIndices> vertex_corners_;
  std::vector<TriangleIndices> uv_corners_;
  std::vector<TriangleIndices> normal_corners_;
  std::vector<std::array<double, 2>> uvs_;
  std::vector<Vec3f> normals_;        // of unit length, or NaN
  std::vector<Vec3f> vertex_colors_;  // as the file encodes them, or NaN
  std::vector<Vec3f> face_colors_;    // for each triangle
  bool has_linear_colors_ = false;
  std::vector<std::int16_t> groups_;  // for each triangle
  std::vector<std::string> group_names_;
  std::vector<std::uint8_t> edges_;  // for each triangle
};

/// Reads the attributes of these kinds from a mesh file that ReadMesh reads. The triangle numbers
/// are ReadMesh's, because the same readers report them. An invalid attribute (text in place of a
/// number, an index without a value) is missing at its corner; it does not make the file invalid.
/// Errors: those of ReadMesh. `options.on_counts` gets counts that include the memory of the
/// attributes.
Result<MeshAttributes> ReadAttributes(std::span<const std::byte> bytes, AttributeKinds kinds,
                                      const MeshReadOptions& options = {});

}  // namespace kdray::core
