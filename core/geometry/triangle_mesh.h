// SPDX-License-Identifier: Apache-2.0
// An indexed triangle mesh as the trees and the leaf tests see it: validated, immutable, in a frame
// of its own. core/io/mesh_reader.h makes MeshData from bytes; core/geometry/mesh_health.h judges
// it.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>
#include <variant>
#include <vector>

#include "core/base/cancel.h"
#include "core/base/result.h"
#include "core/geometry/bounds3.h"
#include "core/geometry/hit.h"
#include "core/geometry/power_of_two.h"
#include "core/geometry/vec3.h"

namespace kdray::core {

enum class MeshFormat : std::uint8_t { kObj, kPly, kStl, kOff, kGlb, kGltf };
constexpr std::string_view Name(MeshFormat format) {
  switch (format) {
    case MeshFormat::kObj:
      return "obj";
    case MeshFormat::kPly:
      return "ply";
    case MeshFormat::kStl:
      return "stl";
    case MeshFormat::kOff:
      return "off";
    case MeshFormat::kGlb:
      return "glb";
    case MeshFormat::kGltf:
      return "gltf";
  }
  return {};
}

/// Largest |coordinate| of a vertex that triangles use: what a 32-bit float holds, rounded down.
inline constexpr double kMaxCoordinate = 3.4e38;
inline constexpr std::size_t kMaxTriangles = std::size_t{1} << 30;
inline constexpr std::size_t kMaxVertices = 0xfffffffe;

using TriangleIndices = std::array<std::uint32_t, 3>;

/// The content of a mesh file, before any check: vertices as stored, in file order, and polygons
/// cut into triangles.
struct MeshData {
  MeshFormat format = MeshFormat::kObj;
  std::vector<Vec3d> vertices;             ///< every vertex stored in the file, used or not
  std::vector<TriangleIndices> triangles;  ///< each index < vertices.size()
  std::uint64_t dropped = 0;  ///< faces with fewer than three corners; they get no number
  std::uint64_t concave =
      0;  ///< polygons that a fan from the first corner would not have triangulated correctly
  bool single_precision =
      false;  ///< the file's coordinates are 32-bit floats (binary STL, PLY float)
  /// The file declares 32-bit floats, but contains numbers that no float prints as (ascii PLY);
  /// they are kept as doubles.
  bool wider_than_declared = false;
};

/// The mesh's local frame: local = (world - origin) * 2^-exponent, exact for every vertex that
/// triangles use. (Except that a coordinate below 2^-1022 of the mesh's size is rounded to a
/// multiple of 2^-1074 of it.) The exponent puts the largest |local coordinate| into [0.5, 1); it
/// is 0 when all coordinates are 0. The origin is 0 on each axis where the mesh lies near 0. On an
/// axis where its centre is farther from 0 than 4 times its longest side, the origin is a number
/// with few bits near the mesh.
struct MeshFrame {
  Vec3d origin;
  int exponent = 0;

  /// Rounds, for points that are not vertices.
  Vec3d ToLocal(const Vec3d& world) const {
    const Vec3d moved = world - origin;
    return {ScaleByPowerOfTwo(moved.x, -exponent), ScaleByPowerOfTwo(moved.y, -exponent),
            ScaleByPowerOfTwo(moved.z, -exponent)};
  }
  Vec3d ToWorld(const Vec3d& local) const {
    return Vec3d{ScaleByPowerOfTwo(local.x, exponent), ScaleByPowerOfTwo(local.y, exponent),
                 ScaleByPowerOfTwo(local.z, exponent)} +
           origin;
  }
  friend bool operator==(const MeshFrame&, const MeshFrame&) = default;
};

/// Immutable, so safe from many threads at once.
class TriangleMesh {
 public:
  /// kEmptyMesh without a triangle; kInvalidMesh when a coordinate of a used vertex is not finite
  /// or beyond kMaxCoordinate (the message names the first such vertex), kMeshTooLarge beyond
  /// kMaxTriangles or kMaxVertices. A vertex that no triangle uses is counted and may have any
  /// coordinates; its local coordinates are 0. O(vertices + triangles). kCancelled,
  /// kDeadlineExceeded.
  static Result<TriangleMesh> Create(const MeshData& data, const CancelToken& cancel = {});
  /// The same without a second copy of the triangles: they are moved out of `data`, also when an
  /// error comes back. The rest of `data` stays.
  static Result<TriangleMesh> Create(MeshData* data, const CancelToken& cancel = {});

  std::size_t triangle_count() const { return triangles_.size(); }
  std::size_t vertex_count() const { return vertex_count_; }  ///< as stored in the file
  const MeshFrame& frame() const { return frame_; }
  const Bounds3d& bounds() const {
    return bounds_;
  }  ///< world units; of the vertices that triangles use
  MeshFormat format() const { return format_; }

  /// Local vertices are 12-byte floats if that is exact for all of them, else 24-byte doubles.
  bool has_double_vertices() const { return vertices_.index() == 1; }
  /// Whether MeshFrame's limit rounded a coordinate. Unknown, and false, for a mesh from FromParts.
  bool has_rounded_vertices() const { return has_rounded_vertices_; }
  std::span<const TriangleIndices> triangles() const { return triangles_; }
  /// Local vertices; T must be the stored type. Visit() picks it.
  template <class T>
  std::span<const Vec3<T>> vertices() const {
    return std::get<std::vector<Vec3<T>>>(vertices_);
  }
  /// Calls f with the span of local vertices, std::span<const Vec3f> or std::span<const Vec3d>.
  template <class F>
  decltype(auto) VisitVertices(F&& f) const {
    if (has_double_vertices()) return f(vertices<double>());
    return f(vertices<float>());
  }

  /// Corner 0, 1 or 2 of a triangle in local coordinates, exact.
  Vec3d LocalCorner(PrimitiveId id, int corner) const {
    const std::uint32_t index = triangles_[id][static_cast<std::size_t>(corner)];
    return VisitVertices([&](auto vertices) { return Vec3d(vertices[index]); });
  }

  /// True for exactly collinear corners. Such a triangle keeps its number, but no ray hits it and
  /// no tree contains it.
  bool IsDegenerate(PrimitiveId id) const { return degenerate_[id]; }
  std::size_t degenerate_count() const { return degenerate_count_; }

  /// Largest |component| of the shortest edge, over triangles that are not degenerate, local units;
  /// infinity if all are degenerate. Because the largest |local coordinate| is in [0.5, 1), it
  /// determines the precision that the mesh needs.
  double shortest_edge() const { return shortest_edge_; }

  /// Memory of vertices, indices and flags.
  std::size_t bytes() const;

  /// For the store (core/store): the parts, and a mesh from parts that were checked when they were
  /// written. kCancelled, kDeadlineExceeded.
  struct Parts;
  const std::vector<bool>& degenerate_flags() const { return degenerate_; }
  static Result<TriangleMesh> FromParts(Parts parts, const CancelToken& cancel = {});

 private:
  TriangleMesh() = default;
  static Result<TriangleMesh> Create(const MeshData& data, std::vector<TriangleIndices> triangles,
                                     const CancelToken& cancel);

  MeshFormat format_ = MeshFormat::kObj;
  MeshFrame frame_;
  Bounds3d bounds_;
  std::size_t vertex_count_ = 0;
  std::variant<std::vector<Vec3f>, std::vector<Vec3d>> vertices_;
  std::vector<TriangleIndices> triangles_;
  std::vector<bool> degenerate_;
  std::size_t degenerate_count_ = 0;
  double shortest_edge_ = 0;
  bool has_rounded_vertices_ = false;
};

struct TriangleMesh::Parts {
  MeshFormat format = MeshFormat::kObj;
  MeshFrame frame;
  Bounds3d bounds;
  std::variant<std::vector<Vec3f>, std::vector<Vec3d>> vertices;
  std::vector<TriangleIndices> triangles;
  std::vector<bool> degenerate;
};

}  // namespace kdray::core
