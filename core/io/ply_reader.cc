#include "core/io/ply_reader.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "core/base/cancel_poll.h"
#include "core/io/claimed_rows.h"
#include "core/io/mesh_error.h"
#include "core/io/ply_body.h"
#include "core/io/ply_header.h"
#include "core/io/polygon.h"

namespace kdray::core {
namespace {

// Where in a row the wanted properties stand.
struct Layout {
  const PlyElement* vertex = nullptr;
  const PlyElement* face = nullptr;
  std::array<std::size_t, 3> xyz{};
  std::size_t corners = 0;
};

Result<Layout> FindLayout(const PlyHeader& header) {
  Layout layout;
  layout.face = header.Find("face");
  if (layout.face == nullptr) {
    if (const PlyElement* strips = header.Find("tristrips")) {
      Error error = AtLine(strips->line, "triangle strips are not read, only the element 'face'");
      error.code = ErrorCode::kUnsupportedMeshFormat;
      return error;
    }
    return Error{ErrorCode::kEmptyMesh, "the PLY file has no element 'face'"};
  }
  if (layout.face->count == 0) return Error{ErrorCode::kEmptyMesh, "the PLY file has no face"};
  layout.vertex = header.Find("vertex");
  if (layout.vertex == nullptr) {
    return AtLine(layout.face->line, "there are faces but no element 'vertex'");
  }
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::string_view name = std::string_view("xyz").substr(axis, 1);
    const std::optional<std::size_t> found = layout.vertex->Find(name);
    if (!found || layout.vertex->properties[*found].IsList()) {
      return AtLine(layout.vertex->line, "the element 'vertex' has no number " + Quoted(name));
    }
    layout.xyz[axis] = *found;
  }
  std::optional<std::size_t> corners = layout.face->Find("vertex_indices");
  if (!corners) corners = layout.face->Find("vertex_index");
  if (!corners || !layout.face->properties[*corners].IsList() ||
      !IsInteger(layout.face->properties[*corners].type)) {
    return AtLine(layout.face->line,
                  "the element 'face' has no list of integers 'vertex_indices' or 'vertex_index'");
  }
  layout.corners = *corners;
  return layout;
}

template <class Body>
class BodyReader {
 public:
  BodyReader(std::string_view file, const PlyHeader& header, const Layout& layout,
             const MeshReadOptions& options)
      : header_(header),
        layout_(layout),
        file_bytes_(file.size()),
        body_(file, header),
        cancel_(options.cancel),
        cutter_(&data_, options.cancel) {
    data_.format = MeshFormat::kPly;
    data_.single_precision = std::all_of(layout.xyz.begin(), layout.xyz.end(), [&](std::size_t i) {
      return layout.vertex->properties[i].type == PlyType::kFloat32;
    });
  }

  // Polygons need the vertices to be cut, and the triangles are counted before memory is taken for
  // them. So the elements are walked through once, up to the later of vertices and faces, and then
  // the faces again.
  Result<MeshData> Read() {
    Body faces = body_;
    bool has_vertices = false;
    bool has_faces = false;
    for (const PlyElement& element : header_.elements) {
      Status status = CheckClaim(element);
      if (!status.ok()) return std::move(status).error();
      if (&element == layout_.vertex) {
        status = ReadVertices();
        has_vertices = true;
      } else if (&element == layout_.face) {
        faces = body_;
        status = CountTriangles();
        has_faces = true;
      } else {
        status = SkipElement(element);
      }
      if (!status.ok()) return std::move(status).error();
      if (has_vertices && has_faces) break;
    }
    body_ = faces;
    if (Status status = ReadFaces(); !status.ok()) return std::move(status).error();
    if (data_.triangles.empty()) {
      return Error{ErrorCode::kEmptyMesh, "the PLY file has no face with three or more corners"};
    }
    return std::move(data_);
  }

 private:
  Status CheckClaim(const PlyElement& element) const {
    // The last line of an ascii file may lack its end.
    const std::size_t least = Body::LeastBytes(element);
    if (least != 0 && element.count > (body_.remaining() + 1) / least) {
      return AtLine(element.line, "the element " + Quoted(element.name) + " claims " +
                                      std::to_string(element.count) + " rows of at least " +
                                      std::to_string(least) + " bytes; " +
                                      std::to_string(body_.remaining()) + " bytes are left");
    }
    if (&element == layout_.vertex && element.count > kMaxVertices) {
      return Error{ErrorCode::kMeshTooLarge, "the PLY file has " + std::to_string(element.count) +
                                                 " vertices; at most " +
                                                 std::to_string(kMaxVertices) + " are allowed"};
    }
    return {};
  }

  // Calls handle(i) for each property i of each row; it returns false when the body has an error.
  template <class F>
  Status ForEachProperty(const PlyElement& element, F&& handle) {
    if (element.properties.empty()) return {};
    for (std::uint64_t row = 0; row < element.count; ++row) {
      if (cancel_.Spend(64)) return cancel_.ToError();
      if (!body_.BeginRow()) return body_.error();
      for (std::size_t i = 0; i < element.properties.size(); ++i) {
        if (!handle(i)) return body_.error();
      }
      body_.EndRow();
    }
    return {};
  }

  Status SkipElement(const PlyElement& element) {
    return ForEachProperty(element,
                           [&](std::size_t i) { return body_.Skip(element.properties[i]); });
  }

  Status ReadVertices() {
    const PlyElement& element = *layout_.vertex;
    const std::size_t last = element.properties.size() - 1;
    Vec3d vertex;
    return ForEachProperty(element, [&](std::size_t i) {
      const PlyProperty& property = element.properties[i];
      const auto axis = std::find(layout_.xyz.begin(), layout_.xyz.end(), i) - layout_.xyz.begin();
      const bool ok = axis < 3 ? body_.ReadNumber(property.type, &vertex[static_cast<int>(axis)])
                               : body_.Skip(property);
      if (ok && i == last) {
        MakeRoom(data_.vertices, element.count, file_bytes_);
        data_.vertices.push_back(vertex);
      }
      return ok;
    });
  }

  Status CountTriangles() {
    const PlyElement& element = *layout_.face;
    std::uint64_t triangles = 0;
    std::uint64_t most_corners = 0;
    Status status = ForEachProperty(element, [&](std::size_t i) {
      const PlyProperty& property = element.properties[i];
      if (i != layout_.corners) return body_.Skip(property);
      std::uint64_t corners = 0;
      if (!body_.ReadLength(property, &corners)) return false;
      triangles += corners < 3 ? 0 : corners - 2;
      most_corners = std::max(most_corners, corners);
      return body_.SkipItems(property.type, corners);
    });
    if (!status.ok()) return status;
    if (triangles > kMaxTriangles) {
      return Error{ErrorCode::kMeshTooLarge, "the PLY file has " + std::to_string(triangles) +
                                                 " triangles; at most " +
                                                 std::to_string(kMaxTriangles) + " are allowed"};
    }
    data_.triangles.reserve(triangles);
    corners_.reserve(most_corners);
    return {};
  }

  Status ReadFaces() {
    const PlyElement& element = *layout_.face;
    return ForEachProperty(element, [&](std::size_t i) {
      const PlyProperty& property = element.properties[i];
      if (i != layout_.corners) return body_.Skip(property);
      if (!ReadCorners(property)) return false;
      Status status = cutter_.Add(corners_);
      return status.ok() || body_.Fail(std::move(status).error());
    });
  }

  bool ReadCorners(const PlyProperty& property) {
    std::uint64_t count = 0;
    if (!body_.ReadLength(property, &count)) return false;
    corners_.clear();
    for (std::uint64_t i = 0; i < count; ++i) {
      std::int64_t index = 0;
      if (!body_.ReadIndex(property.type, &index)) return false;
      if (index < 0 || std::cmp_greater_equal(index, data_.vertices.size())) {
        return body_.Fail({ErrorCode::kInvalidMesh,
                           "vertex " + std::to_string(index) + " does not exist; the file has " +
                               std::to_string(data_.vertices.size()) + ", counted from 0"});
      }
      corners_.push_back(static_cast<std::uint32_t>(index));
    }
    return true;
  }

  const PlyHeader& header_;
  const Layout& layout_;
  std::size_t file_bytes_;
  Body body_;
  CancelPoll cancel_;
  MeshData data_;
  PolygonCutter cutter_;
  std::vector<std::uint32_t> corners_;
};

}  // namespace

Result<MeshData> ReadPly(std::span<const std::byte> bytes, const MeshReadOptions& options) {
  const std::string_view file = SkipByteOrderMark(
      std::string_view(reinterpret_cast<const char*>(bytes.data()), bytes.size()));
  Result<PlyHeader> header = ParsePlyHeader(file);
  if (!header.ok()) return std::move(header).error();
  Result<Layout> layout = FindLayout(*header);
  if (!layout.ok()) return std::move(layout).error();
  if (header->format == PlyFormat::kAscii) {
    return BodyReader<PlyAsciiBody>(file, *header, *layout, options).Read();
  }
  return BodyReader<PlyBinaryBody>(file, *header, *layout, options).Read();
}

}  // namespace kdray::core
