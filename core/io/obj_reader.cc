// SPDX-License-Identifier: Apache-2.0
#include "core/io/obj_reader.h"

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
#include "core/io/foreign_files.h"
#include "core/io/mesh_error.h"
#include "core/io/parse_text.h"
#include "core/io/polygon.h"
#include "core/io/vertex_check.h"

namespace kdray::core {
namespace {

bool IsFace(std::string_view keyword) { return keyword == "f" || keyword == "fo"; }

// Extensions add keywords, and programs write their own remarks ("$ ...", "// ..."). So lines that
// begin with anything except a number are skipped. A number would be the rest of a broken line, and
// text has no control characters.
bool MayBeginStatement(std::string_view keyword) {
  const char first = keyword.front();
  const bool number =
      (first >= '0' && first <= '9') || first == '-' || first == '+' || first == '.';
  return !number && static_cast<unsigned char>(first) > ' ' && first != '\x7f';
}

// Statements whose words are names, which may contain anything, for example a path that ends with a
// backslash.
bool HasNames(std::string_view keyword) {
  static constexpr std::array<std::string_view, 7> kKeywords = {"usemtl", "mtllib", "o",     "g",
                                                                "newmtl", "usemap", "maplib"};
  return std::find(kKeywords.begin(), kKeywords.end(), keyword) != kKeywords.end() ||
         keyword.starts_with("map_");
}

// The numbers of a face's corner: of its vertex, texture coordinates and normal. 0: not given.
struct Corner {
  std::int64_t vertex = 0;
  std::int64_t uv = 0;
  std::int64_t normal = 0;
};

std::optional<Corner> ParseCorner(std::string_view word) {
  std::array<std::int64_t, 3> numbers{};
  for (std::size_t i = 0; i < 3; ++i) {
    const std::size_t slash = i < 2 ? word.find('/') : std::string_view::npos;
    const std::string_view part = word.substr(0, slash);
    if (!part.empty() || i == 0) {
      const std::optional<std::int64_t> number = ParseInteger(part);
      if (!number) return std::nullopt;
      numbers[i] = *number;
    }
    if (slash == std::string_view::npos) break;
    word.remove_prefix(slash + 1);
  }
  return Corner{numbers[0], numbers[1], numbers[2]};
}

// The words of a statement that names a group, with the blanks between them.
std::string_view GroupName(std::string_view keyword, TextCursor rest) {
  const std::string_view first = rest.NextWord();
  std::string_view last = first;
  for (std::string_view word = first; !word.empty(); word = rest.NextWord()) last = word;
  if (first.empty()) return keyword == "g" ? "default" : "";  // the specification's name for it
  return {first.data(), static_cast<std::size_t>(last.data() + last.size() - first.data())};
}

// Walks over the text three times: the first counts, so memory is allocated once and exactly; the
// second reads the vertices; the third reads the faces, because triangulating polygons needs all
// vertices.
class ObjReader {
 public:
  ObjReader(std::string_view text, const MeshReadOptions& options)
      : text_(text),
        options_(options),
        sink_(options.attributes),
        cancel_(options.cancel),
        cutter_(&data_, options.cancel, PolygonCutter::kStepsPerFile,
                sink_ != nullptr ? sink_->cuts() : nullptr) {
    data_.format = MeshFormat::kObj;
    if (sink_ != nullptr) sink_->Begin();
  }

  Result<MeshData> Read() {
    for (const auto pass : {&ObjReader::Count, &ObjReader::ReadVertices, &ObjReader::ReadFaces,
                            &ObjReader::CheckVertices}) {
      if (Status status = (this->*pass)(); !status.ok()) return std::move(status).error();
    }
    if (data_.triangles.empty()) {
      if (counts_.most_corners == 0) return NoFaces("the OBJ file has no face");
      return Error{ErrorCode::kEmptyMesh, "the OBJ file has no face with three or more corners"};
    }
    return std::move(data_);
  }

 private:
  // Calls handle(keyword, cursor) for each statement, with the cursor after the keyword.
  template <class F>
  Status ForEachStatement(F&& handle) {
    TextCursor cursor(text_, {.hash_comments = true, .continuation = true}, 1, &cancel_);
    while (cursor.FindLineWithWords()) {
      const std::string_view keyword = cursor.NextWord();
      if (Status status = handle(keyword, cursor); !status.ok()) return status;
      NextStatement(keyword, cursor);
      if (cancel_.Spend(64)) break;
    }
    return cancel_.ToStatus();
  }

  // A backslash joins the next line to this one. After a name it does so only if that line is not a
  // statement itself; otherwise a path that ends with a backslash would remove a face. Only that
  // line is read ahead: reading all lines that are joined to it, from each of them, would take
  // quadratic time.
  static void NextStatement(std::string_view keyword, TextCursor& cursor) {
    if (!HasNames(keyword)) return cursor.NextLine();
    while (cursor.NextPhysicalLine()) {
      if (IsObjKeyword(cursor.RestOfLine().NextWord())) return;
    }
  }

  bool Wants(AttributeKind kind) const { return sink_ != nullptr && sink_->Wants(kind); }

  Status Count() {
    Status status = ForEachStatement([&](std::string_view keyword, TextCursor& cursor) -> Status {
      if (keyword == "v") {
        ++counts_.vertices;
        if (!has_colors_ && Wants(AttributeKind::kColor)) has_colors_ = HasColor(cursor);
      } else if (IsFace(keyword)) {
        std::size_t corners = 0;
        while (!cursor.NextWord().empty()) ++corners;
        counts_.AddFace(corners);
      } else if (!MayBeginStatement(keyword)) {
        return AtLine(cursor.line(),
                      Quoted(keyword) + " does not begin a statement of an OBJ file");
      } else if (sink_ != nullptr) {
        CountAttribute(keyword);
      }
      return {};
    });
    if (!status.ok()) return status;
    PlanAttributes();
    if (counts_.triangles > kMaxTriangles || counts_.vertices > kMaxVertices) {
      return Error{ErrorCode::kMeshTooLarge,
                   "the OBJ file has " + std::to_string(counts_.triangles) + " triangles and " +
                       std::to_string(counts_.vertices) + " vertices; at most " +
                       std::to_string(kMaxTriangles) + " and " + std::to_string(kMaxVertices) +
                       " are allowed"};
    }
    if (Status told = options_.Counted(counts_); !told.ok()) return told;
    corners_.reserve(counts_.most_corners);
    if (sink_ != nullptr) sink_->Plan(attributes_);
    return {};
  }

  // "v x y z r g b"; the fourth number alone is a weight.
  static bool HasColor(TextCursor cursor) {
    for (int i = 0; i < 6; ++i) {
      if (cursor.NextWord().empty()) return false;
    }
    return true;
  }

  void CountAttribute(std::string_view keyword) {
    if (keyword == "vt") {
      attributes_.uvs += Wants(AttributeKind::kUv) ? 1 : 0;
    } else if (keyword == "vn") {
      attributes_.normals += Wants(AttributeKind::kShadingNormal) ? 1 : 0;
    } else if (keyword == "o" || keyword == "g" || keyword == "usemtl") {
      ++attributes_.groups;
      const bool is_better =
          keyword == "o" || group_keyword_.empty() || (keyword == "g" && group_keyword_ != "o");
      if (is_better) group_keyword_ = keyword;
    }
  }

  void PlanAttributes() {
    if (sink_ == nullptr) return;
    attributes_.triangles = counts_.triangles;
    attributes_.vertex_colors = has_colors_ ? counts_.vertices : 0;
    attributes_.has_vertex_values = has_colors_;
    attributes_.has_corner_uvs = attributes_.uvs != 0;
    attributes_.has_corner_normals = attributes_.normals != 0;
    counts_.other_bytes = sink_->PlannedBytes(attributes_);
    // What follows a polygon: its cuts, and two more numbers for each of its corners.
    if (sink_->cuts() != nullptr) {
      counts_.other_bytes += counts_.most_corners * 2 * (sizeof(TriangleIndices) + 8);
    }
  }

  // As many of a statement's numbers as there are; the others are 0, and an invalid one is NaN.
  static Vec3d ReadNumbers(TextCursor& cursor, int count) {
    Vec3d numbers;
    for (int i = 0; i < count; ++i) {
      const std::string_view word = cursor.NextWord();
      if (word.empty()) break;
      std::optional<double> number = ParseNumber(word);
      if (!number) number = ParseNumber(cursor.BeforeHash(word));
      numbers[i] = number.value_or(std::numeric_limits<double>::quiet_NaN());
    }
    return numbers;
  }

  void ReadAttribute(std::string_view keyword, TextCursor& cursor) {
    if (keyword == "vt" && Wants(AttributeKind::kUv)) {
      const Vec3d uv = ReadNumbers(cursor, 2);
      sink_->AddUv(uv.x, uv.y);
    } else if (keyword == "vn" && Wants(AttributeKind::kShadingNormal)) {
      sink_->AddNormal(ReadNumbers(cursor, 3));
    }
  }

  void ReadColor(TextCursor& cursor) {
    if (HasThreeMore(cursor)) {
      sink_->AddVertexColor(ReadNumbers(cursor, 3));
    } else {
      sink_->AddVertexWithoutColor();
    }
  }
  static bool HasThreeMore(TextCursor cursor) {
    for (int i = 0; i < 3; ++i) {
      if (cursor.NextWord().empty()) return false;
    }
    return true;
  }

  Status ReadVertices() {
    return ForEachStatement([&](std::string_view keyword, TextCursor& cursor) -> Status {
      if (keyword != "v") {
        if (sink_ != nullptr) ReadAttribute(keyword, cursor);
        return {};
      }
      Vec3d vertex;
      for (int axis = 0; axis < 3; ++axis) {
        const std::string_view word = cursor.NextWord();
        std::optional<double> number = ParseCoordinate(word);
        if (!number) number = ParseCoordinate(cursor.BeforeHash(word));
        if (!number) return AtLine(cursor.line(), WhyNotNumber(word));
        vertex[axis] = *number;
      }
      all_valid_ = all_valid_ && IsValidVertex(vertex);
      MakeRoom(data_.vertices, counts_.vertices, text_.size());
      data_.vertices.push_back(vertex);
      if (has_colors_) ReadColor(cursor);
      return {};
    });
  }

  // The statements of each kind before a line.
  struct Seen {
    std::int64_t vertices = 0;
    std::int64_t uvs = 0;
    std::int64_t normals = 0;
  };

  Status ReadFaces() {
    Seen seen;
    return ForEachStatement([&](std::string_view keyword, TextCursor& cursor) -> Status {
      if (keyword == "v") ++seen.vertices;
      if (IsFace(keyword)) return ReadFace(seen, cursor);
      if (sink_ == nullptr) return {};
      if (keyword == "vt") ++seen.uvs;
      if (keyword == "vn") ++seen.normals;
      if (keyword == group_keyword_) sink_->SetGroup(GroupName(keyword, cursor.RestOfLine()));
      return {};
    });
  }

  Status ReadFace(const Seen& seen, TextCursor& cursor) {
    corners_.clear();
    corner_uvs_.clear();
    corner_normals_.clear();
    for (;;) {
      const std::string_view word = cursor.NextWord();
      if (word.empty()) break;
      std::optional<Corner> corner = ParseCorner(word);
      if (!corner) corner = ParseCorner(cursor.BeforeHash(word));
      if (!corner) return AtLine(cursor.line(), Quoted(word) + " is not a corner of a face");
      const std::int64_t number = corner->vertex;
      const std::int64_t index = number < 0 ? seen.vertices + number : number - 1;
      if (index < 0 || std::cmp_greater_equal(index, data_.vertices.size())) {
        return AtLine(cursor.line(), WhyNoVertex(number, seen.vertices));
      }
      corners_.push_back(static_cast<std::uint32_t>(index));
      if (attributes_.has_corner_uvs) {
        corner_uvs_.push_back(PlaceOf(corner->uv, seen.uvs, attributes_.uvs));
      }
      if (attributes_.has_corner_normals) {
        corner_normals_.push_back(PlaceOf(corner->normal, seen.normals, attributes_.normals));
      }
    }
    MakeRoom(data_.triangles, counts_.triangles, text_.size(), corners_.size());
    Status status = cutter_.Add(corners_);
    if (!status.ok()) return AtLine(cursor.line(), std::move(status).error());
    if (sink_ != nullptr) sink_->AddFace({corners_, corner_uvs_, corner_normals_}, &cancel_);
    return {};
  }

  // The place in its table of a number of texture coordinates or a normal; a wrong number has none.
  static std::uint32_t PlaceOf(std::int64_t number, std::int64_t so_far, std::uint64_t count) {
    const std::int64_t place = number < 0 ? so_far + number : number - 1;
    const bool is_there =
        place >= 0 && std::cmp_less(place, count) && std::cmp_less(place, AttributeSink::kNoValue);
    return is_there ? static_cast<std::uint32_t>(place) : AttributeSink::kNoValue;
  }

  Status CheckVertices() {
    if (all_valid_) return {};
    const Result<std::optional<std::size_t>> invalid = FindInvalidVertex(data_, options_);
    if (!invalid.ok()) return invalid.error();
    if (!*invalid) return {};
    std::size_t vertices_so_far = 0;
    return ForEachStatement([&](std::string_view keyword, TextCursor& cursor) -> Status {
      if (keyword != "v" || vertices_so_far++ != **invalid) return {};
      return AtLine(cursor.line(), WhyNotVertex(data_, **invalid));
    });
  }

  std::string WhyNoVertex(std::int64_t number, std::int64_t vertices_so_far) const {
    if (number == 0) return "vertex 0 does not exist; OBJ counts from 1";
    if (number < 0) {
      return "vertex " + std::to_string(number) + " does not exist; " +
             std::to_string(vertices_so_far) + " vertices stand before this line";
    }
    return "vertex " + std::to_string(number) + " does not exist; the file has " +
           std::to_string(data_.vertices.size());
  }

  std::string_view text_;
  MeshCounts counts_;
  const MeshReadOptions& options_;
  AttributeSink* sink_;  // or null
  CancelPoll cancel_;
  MeshData data_;
  PolygonCutter cutter_;
  std::vector<std::uint32_t> corners_;
  bool all_valid_ = true;  // the coordinates of all vertices
  AttributeSink::Counts attributes_;
  bool has_colors_ = false;         // a vertex has one, and the sink takes them
  std::string_view group_keyword_;  // the statement whose names are groups
  std::vector<std::uint32_t> corner_uvs_;
  std::vector<std::uint32_t> corner_normals_;
};

}  // namespace

Result<MeshData> ReadObj(std::span<const std::byte> bytes, const MeshReadOptions& options) {
  const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  CancelPoll poll(options.cancel);
  return ObjReader(WithoutPadding(SkipByteOrderMark(text), &poll), options).Read();
}

bool IsObjKeyword(std::string_view word) {
  // The statements of the specification (Wavefront, Advanced Visualizer appendix B1, version 3.0)
  // and some that exporters add.
  static constexpr std::array<std::string_view, 47> kKeywords = {
      "v",        "vt",   "vn",    "vp",    "f",          "fo",        "l",      "p",
      "o",        "g",    "s",     "mg",    "mtllib",     "usemtl",    "maplib", "usemap",
      "cstype",   "deg",  "bmat",  "step",  "curv",       "curv2",     "surf",   "parm",
      "trim",     "hole", "scrv",  "sp",    "end",        "con",       "bevel",  "c_interp",
      "d_interp", "lod",  "ctech", "stech", "shadow_obj", "trace_obj", "call",   "csh",
      "bsp",      "bzp",  "cdc",   "cdp",   "res",        "vw",        "vc"};
  return std::find(kKeywords.begin(), kKeywords.end(), word) != kKeywords.end();
}

}  // namespace kdray::core
