// SPDX-License-Identifier: Apache-2.0
// Rules on vertices for every format. A coordinate that is not finite, or beyond kMaxCoordinate,
// makes a mesh invalid only in a vertex that a face uses.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "core/base/result.h"
#include "core/geometry/triangle_mesh.h"
#include "core/io/mesh_reader.h"

namespace kdray::core {

inline bool IsValidCoordinate(double value) {
  return std::fabs(value) <= kMaxCoordinate;  // false for NaN
}
inline bool IsValidVertex(const Vec3d& vertex) {
  return IsValidCoordinate(vertex.x) && IsValidCoordinate(vertex.y) && IsValidCoordinate(vertex.z);
}

/// The first axis on which the vertex is not valid.
inline int InvalidAxis(const Vec3d& vertex) {
  return !IsValidCoordinate(vertex.x) ? 0 : !IsValidCoordinate(vertex.y) ? 1 : 2;
}

/// Why the coordinate is invalid; `written`: its text in a text file.
std::string WhyNotCoordinate(double value, std::string_view written = {});

/// Why the vertex with that number (from 0), which a face uses, is invalid.
std::string WhyNotVertex(const MeshData& data, std::size_t vertex);

/// Whether a face may name this vertex, counted from 0.
inline bool IsVertexIndex(std::int64_t index, std::size_t vertices) {
  return index >= 0 && std::cmp_less(index, vertices);
}
/// Why it may not.
std::string WhyNotVertexIndex(std::int64_t index, std::size_t vertices);

/// The first invalid vertex, in file order, that a triangle uses. Also kCancelled and
/// kDeadlineExceeded. O(triangles); for files in which a reader has found an invalid vertex.
Result<std::optional<std::size_t>> FindInvalidVertex(const MeshData& data,
                                                     const MeshReadOptions& options);

}  // namespace kdray::core
