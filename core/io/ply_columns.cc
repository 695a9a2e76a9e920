// SPDX-License-Identifier: Apache-2.0
#include "core/io/ply_columns.h"

#include <optional>
#include <string_view>
#include <utility>

#include "core/io/foreign_files.h"
#include "core/io/mesh_error.h"

namespace kdray::core {
namespace {

// The index of the property with that name, which must be unique; nullopt without one.
Result<std::optional<std::size_t>> FindOnce(const PlyElement& element, std::string_view name) {
  const std::optional<std::size_t> found = element.Find(name);
  if (!found) return found;
  if (const std::optional<std::size_t> second = element.Find(name, *found + 1)) {
    return AtLine(element.properties[*second].line, "a second property " + Quoted(name));
  }
  return found;
}

Status FindVertex(const PlyHeader& header, PlyColumns* columns) {
  columns->vertex = header.Find("vertex");
  if (columns->vertex == nullptr) {
    return AtLine(columns->face->line, "there are faces but no element 'vertex'");
  }
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::string_view name = std::string_view("xyz").substr(axis, 1);
    const Result<std::optional<std::size_t>> found = FindOnce(*columns->vertex, name);
    if (!found.ok()) return found.error();
    if (!*found || columns->vertex->properties[**found].IsList()) {
      return AtLine(columns->vertex->line, "the element 'vertex' has no number " + Quoted(name));
    }
    columns->xyz[axis] = **found;
  }
  return {};
}

Status FindCorners(PlyColumns* columns) {
  const PlyElement& face = *columns->face;
  for (const std::string_view name : {"vertex_indices", "vertex_index"}) {
    const Result<std::optional<std::size_t>> found = FindOnce(face, name);
    if (!found.ok()) return found.error();
    if (!*found) continue;
    const PlyProperty& property = face.properties[**found];
    if (!property.IsList() || !IsInteger(property.type)) break;
    columns->corners = **found;
    return {};
  }
  return AtLine(face.line, "the element " + Quoted(face.name) +
                               " has no list of integers 'vertex_indices' or 'vertex_index'");
}

}  // namespace

Result<PlyColumns> FindPlyColumns(const PlyHeader& header) {
  PlyColumns columns;
  columns.face = header.Find("face");
  if (columns.face == nullptr || columns.face->count == 0) {
    const PlyElement* strips = header.Find("tristrips");
    if (strips != nullptr && strips->count != 0) {
      columns.face = strips;
      columns.is_strips = true;
    } else if (columns.face == nullptr) {
      return NoFaces("the PLY file has no element 'face'");
    } else {
      return NoFaces("the PLY file has no face");
    }
  }
  if (Status status = FindVertex(header, &columns); !status.ok()) return std::move(status).error();
  if (Status status = FindCorners(&columns); !status.ok()) return std::move(status).error();
  return columns;
}

}  // namespace kdray::core
