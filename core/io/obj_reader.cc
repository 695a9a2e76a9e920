#include "core/io/obj_reader.h"

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

// The number before the first slash. The numbers of texture coordinates and normals that follow are
// checked but not used.
std::optional<std::int64_t> ParseCorner(std::string_view word) {
  const std::size_t slash = word.find('/');
  if (slash == std::string_view::npos) return ParseInteger(word);
  std::string_view rest = word.substr(slash + 1);
  const std::size_t second = rest.find('/');
  if (second != std::string_view::npos) {
    const std::string_view normal = rest.substr(second + 1);
    if (!normal.empty() && !ParseInteger(normal)) return std::nullopt;
    rest = rest.substr(0, second);
  }
  if (!rest.empty() && !ParseInteger(rest)) return std::nullopt;
  return ParseInteger(word.substr(0, slash));
}

// Walks over the text three times: the first counts, so memory is allocated once and exactly; the
// second reads the vertices; the third reads the faces, because triangulating polygons needs all
// vertices.
class ObjReader {
 public:
  ObjReader(std::string_view text, const MeshReadOptions& options)
      : text_(text), options_(options), cancel_(options.cancel), cutter_(&data_, options.cancel) {
    data_.format = MeshFormat::kObj;
  }

  Result<MeshData> Read() {
    for (const auto pass : {&ObjReader::Count, &ObjReader::ReadVertices, &ObjReader::ReadFaces,
                            &ObjReader::CheckVertices}) {
      if (Status status = (this->*pass)(); !status.ok()) return std::move(status).error();
    }
    if (data_.triangles.empty()) {
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

  Status Count() {
    Status status = ForEachStatement([&](std::string_view keyword, TextCursor& cursor) -> Status {
      if (keyword == "v") {
        ++counts_.vertices;
      } else if (IsFace(keyword)) {
        std::size_t corners = 0;
        while (!cursor.NextWord().empty()) ++corners;
        counts_.AddFace(corners);
      } else if (!MayBeginStatement(keyword)) {
        return AtLine(cursor.line(),
                      Quoted(keyword) + " does not begin a statement of an OBJ file");
      }
      return {};
    });
    if (!status.ok()) return status;
    if (counts_.triangles > kMaxTriangles || counts_.vertices > kMaxVertices) {
      return Error{ErrorCode::kMeshTooLarge,
                   "the OBJ file has " + std::to_string(counts_.triangles) + " triangles and " +
                       std::to_string(counts_.vertices) + " vertices; at most " +
                       std::to_string(kMaxTriangles) + " and " + std::to_string(kMaxVertices) +
                       " are allowed"};
    }
    if (Status told = options_.Counted(counts_); !told.ok()) return told;
    corners_.reserve(counts_.most_corners);
    return {};
  }

  Status ReadVertices() {
    return ForEachStatement([&](std::string_view keyword, TextCursor& cursor) -> Status {
      if (keyword != "v") return {};
      Vec3d vertex;
      for (int axis = 0; axis < 3; ++axis) {
        const std::string_view word = cursor.NextWord();
        const std::optional<double> number = ParseCoordinate(word);
        if (!number) return AtLine(cursor.line(), WhyNotNumber(word));
        vertex[axis] = *number;
      }
      all_valid_ = all_valid_ && IsValidVertex(vertex);
      MakeRoom(data_.vertices, counts_.vertices, text_.size());
      data_.vertices.push_back(vertex);
      return {};
    });
  }

  Status ReadFaces() {
    std::int64_t vertices_so_far = 0;
    return ForEachStatement([&](std::string_view keyword, TextCursor& cursor) -> Status {
      if (keyword == "v") ++vertices_so_far;
      if (!IsFace(keyword)) return {};
      corners_.clear();
      for (;;) {
        const std::string_view word = cursor.NextWord();
        if (word.empty()) break;
        const std::optional<std::int64_t> number = ParseCorner(word);
        if (!number) return AtLine(cursor.line(), Quoted(word) + " is not a corner of a face");
        const std::int64_t index = *number < 0 ? vertices_so_far + *number : *number - 1;
        if (index < 0 || std::cmp_greater_equal(index, data_.vertices.size())) {
          return AtLine(cursor.line(), WhyNoVertex(*number, vertices_so_far));
        }
        corners_.push_back(static_cast<std::uint32_t>(index));
      }
      MakeRoom(data_.triangles, counts_.triangles, text_.size(), corners_.size());
      Status status = cutter_.Add(corners_);
      if (!status.ok()) return AtLine(cursor.line(), std::move(status).error());
      return {};
    });
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
  CancelPoll cancel_;
  MeshData data_;
  PolygonCutter cutter_;
  std::vector<std::uint32_t> corners_;
  bool all_valid_ = true;  // the coordinates of all vertices
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
