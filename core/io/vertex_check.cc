// SPDX-License-Identifier: Apache-2.0
#include "core/io/vertex_check.h"

#include <algorithm>
#include <charconv>

#include "core/base/cancel_poll.h"
#include "core/io/mesh_error.h"

namespace kdray::core {

std::string WhyNotCoordinate(double value, std::string_view written) {
  char shortest[32];
  if (written.empty()) {
    const auto end = std::to_chars(shortest, shortest + sizeof shortest, value).ptr;
    written = {shortest, static_cast<std::size_t>(end - shortest)};
  }
  // A number beyond the range of double is infinite, but was written with digits.
  const bool has_digits = written.find_first_of("0123456789") != std::string_view::npos;
  const bool is_beyond = has_digits && !std::isnan(value);
  return "the coordinate " + Quoted(written) + (is_beyond ? " is beyond 3.4e38" : " is not finite");
}

std::string WhyNotVertex(const MeshData& data, std::size_t vertex) {
  const Vec3d& v = data.vertices[vertex];
  const int axis = InvalidAxis(v);
  return std::string(1, "xyz"[axis]) + " of vertex " + std::to_string(vertex + 1) +
         " (counted from 1), which a face uses: " + WhyNotCoordinate(v[axis]);
}

std::string WhyNotVertexIndex(std::int64_t index, std::size_t vertices) {
  return "vertex " + std::to_string(index) + " does not exist; the file has " +
         std::to_string(vertices) + ", counted from 0";
}

Result<std::optional<std::size_t>> FindInvalidVertex(const MeshData& data,
                                                     const MeshReadOptions& options) {
  CancelPoll cancel(options.cancel);
  std::size_t first = data.vertices.size();
  for (const TriangleIndices& triangle : data.triangles) {
    if (cancel.Spend(64)) return cancel.ToError();
    for (const std::uint32_t index : triangle) {
      if (index < first && !IsValidVertex(data.vertices[index])) first = index;
    }
  }
  if (first == data.vertices.size()) return std::optional<std::size_t>();
  return std::optional<std::size_t>(first);
}

}  // namespace kdray::core
