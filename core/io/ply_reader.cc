// SPDX-License-Identifier: Apache-2.0
#include "core/io/ply_reader.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "core/base/cancel_poll.h"
#include "core/io/attribute_sink.h"
#include "core/io/claimed_rows.h"
#include "core/io/mesh_error.h"
#include "core/io/ply_attributes.h"
#include "core/io/ply_body.h"
#include "core/io/ply_columns.h"
#include "core/io/ply_header.h"
#include "core/io/polygon.h"
#include "core/io/printed_float.h"
#include "core/io/vertex_check.h"

namespace kdray::core {
namespace {

template <class Body>
class BodyReader {
 public:
  BodyReader(std::string_view file, const PlyHeader& header, const PlyColumns& columns, Body body,
             const MeshReadOptions& options)
      : header_(header),
        columns_(columns),
        file_bytes_(file.size()),
        body_(std::move(body)),
        vertices_(body_),
        options_(options),
        sink_(options.attributes),
        vertex_uses_(columns.vertex, sink_),
        face_uses_(columns.is_strips ? nullptr : columns.face, sink_),
        cancel_(options.cancel),
        cutter_(&data_, options.cancel, PolygonCutter::kStepsPerFile,
                sink_ != nullptr ? sink_->cuts() : nullptr) {
    data_.format = MeshFormat::kPly;
    if (sink_ != nullptr) sink_->Begin();
  }

  // Triangulating polygons needs the vertices, and triangles are counted before memory is allocated
  // for them. So the elements are read once, up to the later of vertices and faces, and then the
  // faces again. `to_the_end`: all elements are read, and nothing may follow them.
  Result<MeshData> Read(bool to_the_end) {
    Body faces = body_;
    bool has_vertices = false;
    bool has_faces = false;
    for (const PlyElement& element : header_.elements) {
      Status status = CheckClaim(element);
      if (!status.ok()) return std::move(status).error();
      if (&element == columns_.vertex) {
        vertices_ = body_;
        counts_.vertices = element.count;
        PlanAttributes();
        status = options_.Counted(counts_);
        if (status.ok()) status = ReadVertices();
        has_vertices = true;
      } else if (&element == columns_.face) {
        faces = body_;
        status = CountTriangles();
        has_faces = true;
      } else {
        status = SkipElement(element);
      }
      if (!status.ok()) return std::move(status).error();
      if (!body_.EndElement()) return body_.error();
      if (has_vertices && has_faces && !to_the_end) break;
    }
    if constexpr (Body::kIsText) {
      if (to_the_end && !body_.AtEnd()) {
        body_.Fail({ErrorCode::kInvalidMesh, "text follows the last row"});
        return body_.error();
      }
    }
    body_ = faces;
    if (Status status = ReadFaces(); !status.ok()) return std::move(status).error();
    if (Status status = CheckVertices(); !status.ok()) return std::move(status).error();
    if (data_.triangles.empty()) {
      return Error{ErrorCode::kEmptyMesh, "the PLY file has no face with three or more corners"};
    }
    return std::move(data_);
  }

 private:
  Status CheckClaim(const PlyElement& element) const {
    // The last line of an ascii file may have no line end.
    const std::size_t least = Body::LeastBytes(element);
    if (least != 0 && element.count > (body_.remaining() + 1) / least) {
      return AtLine(element.line, "the element " + Quoted(element.name) + " claims " +
                                      std::to_string(element.count) + " rows of at least " +
                                      std::to_string(least) + " bytes; " +
                                      std::to_string(body_.remaining()) + " bytes are left");
    }
    if (&element == columns_.vertex && element.count > kMaxVertices) {
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
        if (!handle(i)) return cancel_.stopped() ? cancel_.ToError() : body_.error();
      }
      if (!body_.EndRow()) return body_.error();
    }
    return {};
  }

  Status SkipElement(const PlyElement& element) {
    return ForEachProperty(element,
                           [&](std::size_t i) { return body_.Skip(element.properties[i]); });
  }

  // Face counts are known after the vertices if the file has that order, so values are planned
  // before arrays of triangles.
  void PlanAttributes() {
    if (sink_ == nullptr) return;
    const std::uint64_t vertices = counts_.vertices;
    AttributeSink::Counts counts;
    counts.triangles = counts_.triangles;
    counts.uvs = vertex_uses_.has_uv() ? vertices : 0;
    counts.normals = vertex_uses_.has_normal() ? vertices : 0;
    counts.vertex_colors = vertex_uses_.has_color() ? vertices : 0;
    counts.has_vertex_values = !vertex_uses_.empty();
    counts.has_face_colors = face_uses_.has_color();
    counts_.other_bytes = sink_->PlannedBytes(counts);
    if (sink_->cuts() != nullptr) {
      counts_.other_bytes += counts_.most_corners * 2 * sizeof(TriangleIndices);
    }
    planned_ = counts;
  }

  // A number of an attribute in a row of vertices or faces.
  bool ReadAttribute(const PlyProperty& property, const PlyUse& use) {
    double value = 0;
    if constexpr (Body::kIsText) {
      if (!body_.Skip(property)) return false;
      value = ParseNumber(body_.word()).value_or(std::numeric_limits<double>::quiet_NaN());
    } else {
      if (!body_.ReadNumber(property.type, &value)) return false;
    }
    if (use.meaning == PlyMeaning::kColor) value /= FullPlyColor(property.type);
    row_[static_cast<std::size_t>(use.meaning)][use.component] = value;
    return true;
  }

  const Vec3d& Row(PlyMeaning meaning) const { return row_[static_cast<std::size_t>(meaning)]; }

  void AddVertexAttributes() {
    if (vertex_uses_.has_uv()) sink_->AddUv(Row(PlyMeaning::kUv).x, Row(PlyMeaning::kUv).y);
    if (vertex_uses_.has_normal()) sink_->AddNormal(Row(PlyMeaning::kNormal));
    if (vertex_uses_.has_color()) sink_->AddVertexColor(Row(PlyMeaning::kColor));
  }

  bool IsFloat(std::size_t axis) const {
    return columns_.vertex->properties[columns_.xyz[axis]].type == PlyType::kFloat32;
  }

  // Numbers that the header declares as floats are read as floats up to the first that is not the
  // text of a float; then the vertices are read again, as doubles.
  Status ReadVertices() {
    Status status = ReadVerticesOnce();
    if (has_wide_text_) {
      data_.vertices.clear();
      if (sink_ != nullptr) sink_->BeginValues();
      body_ = vertices_;
      status = ReadVerticesOnce();
    }
    data_.single_precision = !has_wide_text_ && IsFloat(0) && IsFloat(1) && IsFloat(2);
    data_.wider_than_declared = has_wide_text_;
    return status;
  }

  Status ReadVerticesOnce() {
    const PlyElement& element = *columns_.vertex;
    const std::size_t last = element.properties.size() - 1;
    if (!vertex_uses_.empty()) sink_->Plan(planned_);
    Vec3d vertex;
    return ForEachProperty(element, [&](std::size_t i) {
      const PlyProperty& property = element.properties[i];
      const auto axis =
          std::find(columns_.xyz.begin(), columns_.xyz.end(), i) - columns_.xyz.begin();
      const PlyUse use = vertex_uses_.of(i);
      const bool ok = axis < 3 ? ReadCoordinate(property.type, &vertex[static_cast<int>(axis)])
                      : use.meaning != PlyMeaning::kNothing ? ReadAttribute(property, use)
                                                            : body_.Skip(property);
      if (ok && i == last) {
        if (!vertex_uses_.empty()) AddVertexAttributes();
        MakeRoom(data_.vertices, element.count, file_bytes_);
        data_.vertices.push_back(vertex);
        all_valid_ = all_valid_ && IsValidVertex(vertex);
      }
      return ok;
    });
  }

  bool ReadCoordinate(PlyType type, double* value) {
    if (!body_.ReadNumber(type, value)) return false;
    if constexpr (Body::kIsText) {
      if (type == PlyType::kFloat32 && !has_wide_text_) {
        const std::optional<float> number = ParsePrintedFloat(body_.word(), *value);
        has_wide_text_ = !number;
        if (number) *value = static_cast<double>(*number);
        return number.has_value();
      }
    }
    return true;
  }

  Status CheckVertices() {
    if (all_valid_) return {};
    const Result<std::optional<std::size_t>> invalid = FindInvalidVertex(data_, options_);
    if (!invalid.ok()) return invalid.error();
    if (!*invalid) return {};
    const std::size_t vertex = **invalid;
    const auto axis = static_cast<std::size_t>(InvalidAxis(data_.vertices[vertex]));
    const PlyElement& element = *columns_.vertex;
    body_ = vertices_;
    std::size_t row = 0;
    return ForEachProperty(element, [&](std::size_t i) {
      if (!body_.Skip(element.properties[i])) return false;
      if (row == vertex && i == columns_.xyz[axis]) {
        return body_.Fail({ErrorCode::kInvalidMesh, WhyNotVertex(data_, vertex)});
      }
      row += i + 1 == element.properties.size() ? 1 : 0;
      return true;
    });
  }

  Status CountTriangles() {
    const PlyElement& element = *columns_.face;
    Status status = ForEachProperty(element, [&](std::size_t i) {
      const PlyProperty& property = element.properties[i];
      if (i != columns_.corners) return body_.Skip(property);
      std::uint64_t corners = 0;
      if (!body_.ReadLength(property, &corners)) return false;
      if (columns_.is_strips) return CountStrip(property.type, corners, &counts_.triangles);
      if (corners < 3 && !body_.AllowsShortFaces()) {
        return body_.Fail(
            {ErrorCode::kInvalidMesh, "a face of " + std::to_string(corners) +
                                          " corners; rows that are not lines need at least 3"});
      }
      counts_.AddFace(corners);
      return body_.SkipItems(property.type, corners);
    });
    if (!status.ok()) return status;
    if (counts_.triangles > kMaxTriangles) {
      return Error{ErrorCode::kMeshTooLarge,
                   "the PLY file has " + std::to_string(counts_.triangles) +
                       " triangles; at most " + std::to_string(kMaxTriangles) + " are allowed"};
    }
    PlanAttributes();
    if (Status told = options_.Counted(counts_); !told.ok()) return told;
    corners_.reserve(counts_.most_corners);
    return {};
  }

  // A row of strips is a list of vertices in which -1 ends a strip. Each vertex from the third of
  // its strip on makes a triangle with the two before it.
  bool CountStrip(PlyType type, std::uint64_t items, std::uint64_t* triangles) {
    std::uint64_t length = 0;
    for (std::uint64_t i = 0; i < items; ++i) {
      if (cancel_.Spend(8)) return false;
      std::int64_t index = 0;
      if (!body_.ReadIndex(type, &index)) return false;
      length = index == -1 ? 0 : length + 1;
      *triangles += length >= 3 ? 1 : 0;
    }
    return true;
  }

  bool ReadStrip(const PlyProperty& property) {
    std::uint64_t items = 0;
    if (!body_.ReadLength(property, &items)) return false;
    std::uint64_t length = 0;
    std::array<std::uint32_t, 2> last{};
    for (std::uint64_t i = 0; i < items; ++i) {
      if (cancel_.Spend(8)) return false;
      std::int64_t index = 0;
      if (!body_.ReadIndex(property.type, &index)) return false;
      if (index == -1) {
        length = 0;
        continue;
      }
      if (!CheckIndex(index)) return false;
      const auto corner = static_cast<std::uint32_t>(index);
      if (++length >= 3) {
        // The winding alternates along a strip.
        const bool turned = length % 2 == 0;
        MakeRoom(data_.triangles, counts_.triangles, file_bytes_);
        data_.triangles.push_back({last[turned ? 1 : 0], last[turned ? 0 : 1], corner});
        if (sink_ != nullptr) sink_->AddTriangle({.vertices = data_.triangles.back()});
      }
      last = {last[1], corner};
    }
    return true;
  }

  Status ReadFaces() {
    const PlyElement& element = *columns_.face;
    const std::size_t last = element.properties.size() - 1;
    if (sink_ != nullptr) sink_->Plan(planned_);
    return ForEachProperty(element, [&](std::size_t i) {
      const PlyProperty& property = element.properties[i];
      if (!ReadFaceProperty(property, i)) return false;
      // The colour may stand before or after the corners.
      if (i == last && sink_ != nullptr && !columns_.is_strips) {
        AttributeSink::Face face{.vertices = corners_};
        if (face_uses_.has_color()) face.color = Row(PlyMeaning::kColor);
        sink_->AddFace(face, &cancel_);
      }
      return true;
    });
  }

  bool ReadFaceProperty(const PlyProperty& property, std::size_t i) {
    if (i != columns_.corners) {
      const PlyUse use = face_uses_.of(i);
      return use.meaning == PlyMeaning::kNothing ? body_.Skip(property)
                                                 : ReadAttribute(property, use);
    }
    if (columns_.is_strips) return ReadStrip(property);
    if (!ReadCorners(property)) return false;
    MakeRoom(data_.triangles, counts_.triangles, file_bytes_, corners_.size());
    Status status = cutter_.Add(corners_);
    return status.ok() || body_.Fail(std::move(status).error());
  }

  bool ReadCorners(const PlyProperty& property) {
    std::uint64_t count = 0;
    if (!body_.ReadLength(property, &count)) return false;
    corners_.clear();
    for (std::uint64_t i = 0; i < count; ++i) {
      if (cancel_.Spend(8)) return false;
      std::int64_t index = 0;
      if (!body_.ReadIndex(property.type, &index) || !CheckIndex(index)) return false;
      corners_.push_back(static_cast<std::uint32_t>(index));
    }
    return true;
  }

  bool CheckIndex(std::int64_t index) {
    if (IsVertexIndex(index, data_.vertices.size())) return true;
    return body_.Fail({ErrorCode::kInvalidMesh, WhyNotVertexIndex(index, data_.vertices.size())});
  }

  const PlyHeader& header_;
  const PlyColumns& columns_;
  std::size_t file_bytes_;
  Body body_;
  Body vertices_;  // where they begin
  const MeshReadOptions& options_;
  AttributeSink* sink_;  // or null
  PlyAttributes vertex_uses_;
  PlyAttributes face_uses_;
  AttributeSink::Counts planned_;
  std::array<Vec3d, kPlyMeanings> row_;  // of the row that is being read, by PlyMeaning
  CancelPoll cancel_;
  MeshData data_;
  MeshCounts counts_;
  bool has_wide_text_ = false;  // a declared float that is not the text of a float
  bool all_valid_ = true;       // the coordinates of all vertices
  PolygonCutter cutter_;
  std::vector<std::uint32_t> corners_;
};

// Nearly every file has one row a line, which separates a broken row from the next. But rows may be
// words on any lines, and programs also write more words in a row than they declare. So a file that
// does not fit even lines is read again, with the layout that its number of lines suggests.
class AsciiReader {
 public:
  AsciiReader(std::string_view file, const PlyHeader& header, const PlyColumns& columns,
              const MeshReadOptions& options)
      : file_(file), header_(header), columns_(columns), options_(options) {}

  Result<MeshData> Read() const {
    Result<MeshData> even = ReadBy(PlyLayout::kEvenLines);
    if (even.ok() || !IsOfTheFile(even.error())) return even;
    std::uint64_t rows = 0;
    for (const PlyElement& element : header_.elements) {
      if (element.properties.empty()) continue;
      rows += std::min<std::uint64_t>(element.count, file_.size());
    }
    const Result<PlyLines> lines = CountPlyLines(file_, header_, rows + 1, options_.cancel);
    if (!lines.ok()) return lines.error();
    const PlyLayout free = lines->even ? PlyLayout::kWrapped : PlyLayout::kWords;
    if (lines->count < rows) return ReadBy(free);
    if (lines->count == rows) return ReadBy(PlyLayout::kLines);
    Result<MeshData> words = ReadBy(free);
    if (words.ok() || !IsOfTheFile(words.error())) return words;
    Result<MeshData> by_lines = ReadBy(PlyLayout::kLines);
    return by_lines.ok() || !IsOfTheFile(by_lines.error()) ? std::move(by_lines) : std::move(words);
  }

 private:
  Result<MeshData> ReadBy(PlyLayout layout) const {
    CancelPoll poll(options_.cancel);
    return BodyReader<PlyAsciiBody>(file_, header_, columns_, {file_, header_, layout, &poll},
                                    options_)
        .Read(layout == PlyLayout::kWords || layout == PlyLayout::kWrapped);
  }

  std::string_view file_;
  const PlyHeader& header_;
  const PlyColumns& columns_;
  const MeshReadOptions& options_;
};

}  // namespace

Result<MeshData> ReadPly(std::span<const std::byte> bytes, const MeshReadOptions& options) {
  const std::string_view file = SkipByteOrderMark(
      std::string_view(reinterpret_cast<const char*>(bytes.data()), bytes.size()));
  CancelPoll poll(options.cancel);
  Result<PlyHeader> header = ParsePlyHeader(file, &poll);
  if (!header.ok()) return std::move(header).error();
  Result<PlyColumns> columns = FindPlyColumns(*header);
  if (!columns.ok()) return std::move(columns).error();
  if (header->format == PlyFormat::kAscii) {
    const std::size_t body = WithoutPadding(file.substr(header->body), &poll).size();
    return AsciiReader(file.substr(0, header->body + body), *header, *columns, options).Read();
  }
  return BodyReader<PlyBinaryBody>(file, *header, *columns, {file, *header}, options).Read(false);
}

}  // namespace kdray::core
