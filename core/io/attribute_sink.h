// SPDX-License-Identifier: Apache-2.0
// Takes from the mesh readers what core/io/mesh_attributes.h keeps: they report values, groups and
// faces as they read them, if MeshReadOptions names a sink.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <unordered_map>
#include <utility>
#include <vector>

#include "core/base/cancel_poll.h"
#include "core/geometry/triangle_mesh.h"
#include "core/geometry/vec3.h"
#include "core/io/mesh_attributes.h"

namespace kdray::core {

/// A group's name as it is shown: cut to 128 bytes between two characters; bytes that are not UTF-8
/// become U+FFFD.
std::string ShownGroupName(std::string_view name);

/// For one thread and one file at a time. The order of calls: Begin, Plan, the values of vertices
/// and corners, then faces. Names of groups are collected even if no kind is wanted, because a
/// mesh's description has them; arrays are made only for wanted kinds.
class AttributeSink {
 public:
  static constexpr std::uint32_t kNoValue = MeshAttributes::kNoValue;

  explicit AttributeSink(AttributeKinds kinds) { attributes_.kinds_ = kinds; }

  bool Wants(AttributeKind kind) const { return attributes_.kinds_.Has(kind); }

  /// Forgets everything: a reader begins, or begins again.
  void Begin();

  /// What the file contains, counted before memory is taken. Values of kinds that are not wanted
  /// count as 0.
  struct Counts {
    std::uint64_t triangles = 0;
    std::uint64_t uvs = 0;
    std::uint64_t normals = 0;
    std::uint64_t vertex_colors = 0;
    bool has_vertex_values = false;  ///< some values belong to vertices
    bool has_corner_uvs = false;     ///< uvs have indices of their own
    bool has_corner_normals = false;
    bool has_face_colors = false;
    std::uint64_t groups = 0;  ///< statements that name one
  };
  /// The memory of the attributes at most.
  std::uint64_t PlannedBytes(const Counts& counts) const;
  /// Reserves it. Call when `on_counts` has agreed to PlannedBytes.
  void Plan(const Counts& counts);

  // Values, in the order of their numbers. Only for kinds that are wanted.

  /// Forgets the values, which are read again.
  void BeginValues();
  void AddUv(double s, double t) { attributes_.uvs_.push_back({s, t}); }
  /// Of any length.
  void AddNormal(const Vec3d& normal);
  /// As the file encodes it. A file with numbers beyond 1 means 255 by its greatest.
  void AddVertexColor(const Vec3d& color) { attributes_.vertex_colors_.push_back(Vec3f(color)); }
  void AddVertexWithoutColor();
  /// All colours of the file are linear, not sRGB.
  void SetLinearColors() { attributes_.has_linear_colors_ = true; }

  // Groups: the faces that follow belong to it. A group without a face is not kept.

  /// The group of this name, which may have faces already. `name` must stay valid until the next
  /// call about groups.
  void SetGroup(std::string_view name) { SetGroup(name, false); }
  /// A group of its own, even if another has this name.
  void StartGroup(std::string_view name) { SetGroup(name, true); }
  void EndGroup();

  // Faces.

  /// The corners of a face in its order.
  struct Face {
    std::span<const std::uint32_t> vertices;
    std::span<const std::uint32_t> uvs = {};      ///< or kNoValue; empty: the value of the vertex
    std::span<const std::uint32_t> normals = {};  ///< the same
    std::optional<Vec3d> color = std::nullopt;    ///< as AddVertexColor
  };
  /// Where PolygonCutter puts which corners its triangles have; null if no kind needs that.
  std::vector<TriangleIndices>* cuts() { return attributes_.kinds_.empty() ? nullptr : &cuts_; }
  /// The face that has become the triangles in cuts(), which it empties. Incomplete once the poll
  /// has stopped.
  void AddFace(const Face& face, CancelPoll* poll);
  /// A face of three corners that no cutter has seen.
  void AddTriangle(const Face& face);

  /// The names of groups with triangles, for a sink without kinds; call once.
  std::vector<std::string> TakeGroupNames() { return std::move(attributes_.group_names_); }
  /// The result; call once.
  MeshAttributes Finish(CancelPoll* poll);

 private:
  struct GroupOfFaces {
    std::string_view name;
    bool is_new = false;
  };

  void SetGroup(std::string_view name, bool is_new);
  void FindGroup();
  void AddCut(const Face& face, const TriangleIndices& cut);

  MeshAttributes attributes_;
  std::uint64_t triangles_ = 0;
  std::uint64_t planned_triangles_ = 0;
  std::vector<TriangleIndices> cuts_;
  std::int16_t group_ = MeshAttributes::kNoGroup;
  std::optional<GroupOfFaces> next_group_;  // of the next face
  std::unordered_map<std::string, std::int16_t> group_numbers_;
};

}  // namespace kdray::core
