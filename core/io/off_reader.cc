// SPDX-License-Identifier: Apache-2.0
#include "core/io/off_reader.h"

#include <algorithm>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/base/cancel_poll.h"
#include "core/io/attribute_sink.h"
#include "core/io/claimed_rows.h"
#include "core/io/foreign_files.h"
#include "core/io/format_sniffer.h"
#include "core/io/mesh_error.h"
#include "core/io/parse_text.h"
#include "core/io/polygon.h"
#include "core/io/vertex_check.h"

namespace kdray::core {
namespace {

struct Keyword {
  bool has_other_dimension = false;
  std::uint64_t numbers = 3;  // of a vertex
  bool has_normals = false;
  bool has_colors = false;
  std::string_view rest;  // attached to it: "8" of "OFF8"
};

std::optional<Keyword> ParseKeyword(std::string_view word) {
  if (word.size() > kLongestNumber) return std::nullopt;
  Keyword keyword;
  const auto pass = [&](std::string_view prefix) {
    if (!word.starts_with(prefix)) return false;
    word.remove_prefix(prefix.size());
    return true;
  };
  // The manual has the prefixes in one order, programs write them in every order.
  while (!word.starts_with("OFF")) {
    if (pass("ST")) {
      keyword.numbers += 2;
    } else if (pass("C")) {
      keyword.numbers += 4;
      keyword.has_colors = true;
    } else if (pass("N")) {
      keyword.numbers += 3;
      keyword.has_normals = true;
    } else if (pass("4") || pass("n")) {
      keyword.has_other_dimension = true;
    } else {
      break;
    }
  }
  if (!pass("OFF") && !EqualsIgnoringCase(std::exchange(word, {}), "off")) return std::nullopt;
  if (!std::all_of(word.begin(), word.end(), [](char c) { return c >= '0' && c <= '9'; })) {
    return std::nullopt;
  }
  keyword.rest = word;
  return keyword;
}

// How the numbers are distributed over lines.
enum class Layout : std::uint8_t {
  kEvenLines,  // a vertex a line, all with as many numbers; a face a line
  kLines,      // the same, but a vertex may have any numbers after the first three
  kFree,  // only these numbers, on any lines, also on the line of the counts; the first of several
          // faces begins a line, and the colour of a face ends with its line
  kFreeBlock,  // the same, from the line after the counts
};

class OffReader {
 public:
  OffReader(std::string_view text, const MeshReadOptions& options)
      : options_(options),
        cancel_(options.cancel),
        cursor_(text, {.hash_comments = true}, 1, &cancel_),
        body_(cursor_),
        file_bytes_(text.size()),
        sink_(options.attributes),
        cutter_(&data_, options.cancel, PolygonCutter::kStepsPerFile,
                sink_ != nullptr ? sink_->cuts() : nullptr) {}

  // Nearly every file has one row a line, which separates a broken row from the next. The manual
  // allows numbers on any line, and programs write more numbers after a vertex than the keyword
  // announces. So a file that does not fit even lines is read again, with the layout that its
  // number of lines suggests.
  Result<MeshData> Read() {
    if (Status status = ReadCounts(); !status.ok()) return std::move(status).error();
    if (faces_ == 0) {
      // Without its keyword, ReadOff() says what the file may be.
      return has_keyword_ ? NoFaces("the OFF file has no face")
                          : Error{ErrorCode::kEmptyMesh, "the OFF file has no face"};
    }
    Result<MeshData> even = ReadBody(Layout::kEvenLines);
    if (even.ok() || !IsOfTheFile(even.error())) return even;
    const Result<std::uint64_t> lines = CountLines();
    if (!lines.ok()) return lines.error();
    if (*lines < vertices_ + faces_) return ReadBody(Layout::kFree);
    if (*lines == vertices_ + faces_) return ReadEither(Layout::kLines, Layout::kFreeBlock);
    return ReadEither(Layout::kFreeBlock, Layout::kLines);
  }

  bool has_keyword() const { return has_keyword_; }

 private:
  Error Broken(std::string_view cause) const { return AtLine(cursor_.line(), cause); }

  Status ReadCounts() {
    if (!cursor_.FindLineWithWords()) return Broken("the OFF file has no counts");
    std::string_view word = cursor_.NextWord();
    if (const std::optional<Keyword> keyword = ParseKeyword(word)) {
      has_keyword_ = true;
      numbers_ = keyword->numbers;
      has_vertex_colors_ = keyword->has_colors && Wants(AttributeKind::kColor);
      color_begin_ = keyword->has_normals ? 6 : 3;
      word = keyword->rest.empty() ? cursor_.NextWord() : keyword->rest;
      if (keyword->has_other_dimension || word == "BINARY") {
        Error error = Broken("only ascii OFF files with three coordinates are supported");
        error.code = ErrorCode::kUnsupportedMeshFormat;
        return error;
      }
      if (word.empty()) word = cursor_.NextWordOnAnyLine();
      if (word.empty()) return Broken("the OFF file has no counts");
    }
    for (std::uint64_t* count : {&vertices_, &faces_}) {
      const std::optional<std::int64_t> number = ParseCount(word);
      if (!number) return Broken(WhyNotInteger(word));
      if (*number < 0) return Broken(Quoted(word) + " is not a count");
      *count = static_cast<std::uint64_t>(*number);
      if (count == &vertices_) word = cursor_.NextWordOnAnyLine();
    }
    PassEdgeCount();
    return CheckClaims();
  }

  // It may be missing, or be alone on the next line, where a vertex cannot be.
  void PassEdgeCount() {
    if (!cursor_.NextWord().empty()) return;
    TextCursor ahead = cursor_;
    if (!ahead.FindLineWithWords() || !ParseCount(ahead.NextWord())) return;
    if (ahead.NextWord().empty()) cursor_ = ahead;
  }

  // The shortest rows of a vertex and a face are "0 0 0" and "0"; the last row may have no line
  // end.
  Status CheckClaims() {
    const std::uint64_t left = cursor_.remaining() + 1;
    if (vertices_ > left / 6 || faces_ > (left - 6 * vertices_) / 2) {
      return Broken(std::to_string(vertices_) + " vertices and " + std::to_string(faces_) +
                    " faces do not fit into the " + std::to_string(cursor_.remaining()) +
                    " bytes that follow");
    }
    if (vertices_ > kMaxVertices) {
      return Error{ErrorCode::kMeshTooLarge, "the OFF file has " + std::to_string(vertices_) +
                                                 " vertices; at most " +
                                                 std::to_string(kMaxVertices) + " are allowed"};
    }
    body_ = cursor_;
    return {};
  }

  // The number of lines with words, at most the number of rows plus one.
  Result<std::uint64_t> CountLines() {
    cursor_ = body_;
    std::uint64_t lines = 0;
    for (cursor_.NextLine(); lines <= vertices_ + faces_ && cursor_.FindLineWithWords();
         cursor_.NextLine()) {
      if (cancel_.Spend(64)) return cancel_.ToError();
      ++lines;
    }
    return lines;
  }

  Result<MeshData> ReadEither(Layout likely, Layout other) {
    Result<MeshData> mesh = ReadBody(likely);
    if (mesh.ok() || !IsOfTheFile(mesh.error())) return mesh;
    Result<MeshData> second = ReadBody(other);
    return second.ok() || !IsOfTheFile(second.error()) ? std::move(second) : std::move(mesh);
  }

  Result<MeshData> ReadBody(Layout layout) {
    layout_ = layout;
    if (sink_ != nullptr) sink_->Begin();
    data_ = {};
    data_.format = MeshFormat::kOff;
    all_valid_ = true;
    if (Status status = ReadVertices(); !status.ok()) return std::move(status).error();
    const TextCursor first_face = cursor_;
    if (Status status = CountTriangles(); !status.ok()) return std::move(status).error();
    cursor_ = first_face;
    if (Status status = ReadFaces(); !status.ok()) return std::move(status).error();
    if (is_free() && cursor_.FindLineWithWords()) {
      return Broken("text follows the last face");
    }
    if (Status status = CheckVertices(); !status.ok()) return std::move(status).error();
    if (data_.triangles.empty()) {
      return Error{ErrorCode::kEmptyMesh, "the OFF file has no face with three or more corners"};
    }
    return std::move(data_);
  }

  bool is_free() const { return layout_ == Layout::kFree || layout_ == Layout::kFreeBlock; }

  std::string_view NextWordOfRow() {
    return is_free() ? cursor_.NextWordOnAnyLine() : cursor_.NextWord();
  }

  // Calls handle(vertex, i) for each vertex; it returns false to end the walk.
  template <class F>
  Status ForEachVertex(F&& handle) {
    cursor_ = body_;
    // A file of fewer lines than rows may have its first vertex on the line of the counts.
    if (layout_ != Layout::kFree) cursor_.NextLine();
    std::uint64_t even = 0;  // numbers on each line
    for (std::uint64_t i = 0; i < vertices_; ++i) {
      if (cancel_.Spend(64)) return cancel_.ToError();
      if (!cursor_.FindLineWithWords()) return EndsAfter(i, vertices_, "vertices");
      Vec3d vertex;
      for (int axis = 0; axis < 3; ++axis) {
        const std::string_view word = NextWordOfRow();
        std::optional<double> number = ParseCoordinate(word);
        if (!number) number = ParseCoordinate(cursor_.BeforeHash(word));
        if (!number) return Broken(WhyNotNumber(word));
        vertex[axis] = *number;
      }
      if (!handle(vertex, i)) return {};
      if (is_free()) {
        for (std::uint64_t k = 3; k < numbers_; ++k) cursor_.NextWordOnAnyLine();
        continue;
      }
      if (layout_ == Layout::kEvenLines) {
        std::uint64_t numbers = 3;
        while (!cursor_.NextWord().empty()) ++numbers;
        if (i != 0 && numbers != even) return Broken("a line of another length");
        even = numbers;
      }
      cursor_.NextLine();
    }
    // Otherwise a file with a missing vertex would read its first face as one.
    const bool must_end_line =
        layout_ == Layout::kFreeBlock || (layout_ == Layout::kFree && faces_ != 1);
    if (must_end_line && !cursor_.NextWord().empty()) {
      return Broken("more text follows the last vertex on its line");
    }
    return {};
  }

  bool Wants(AttributeKind kind) const { return sink_ != nullptr && sink_->Wants(kind); }

  // The three numbers after `skip` others of the row that the cursor is in; nullopt if they are not
  // there.
  std::optional<Vec3d> ReadColor(std::size_t skip, bool on_any_line) const {
    TextCursor ahead = cursor_;
    Vec3d color;
    for (std::size_t i = 0; i < skip + 3; ++i) {
      const std::string_view word = on_any_line ? ahead.NextWordOnAnyLine() : ahead.NextWord();
      const std::optional<double> number = ParseNumber(word);
      if (!number) return std::nullopt;
      if (i >= skip) color[static_cast<int>(i - skip)] = *number;
    }
    return color;
  }

  void AddVertexColor() {
    if (const auto color = ReadColor(color_begin_ - 3, is_free())) {
      sink_->AddVertexColor(*color);
    } else {
      sink_->AddVertexWithoutColor();
    }
  }

  // Faces may have colours of their own, whatever the keyword says.
  void PlanAttributes(MeshCounts* counts) {
    if (sink_ == nullptr) return;
    planned_.triangles = counts->triangles;
    planned_.vertex_colors = has_vertex_colors_ ? vertices_ : 0;
    planned_.has_vertex_values = has_vertex_colors_;
    planned_.has_face_colors = Wants(AttributeKind::kColor) && !has_vertex_colors_;
    counts->other_bytes = sink_->PlannedBytes(planned_);
    if (sink_->cuts() != nullptr) {
      counts->other_bytes += counts->most_corners * 2 * sizeof(TriangleIndices);
    }
  }

  Status ReadVertices() {
    MeshCounts counts{.vertices = vertices_};
    PlanAttributes(&counts);
    if (Status told = options_.Counted(counts); !told.ok()) return told;
    if (sink_ != nullptr) sink_->Plan(planned_);
    return ForEachVertex([&](const Vec3d& vertex, std::uint64_t) {
      if (has_vertex_colors_) AddVertexColor();
      MakeRoom(data_.vertices, vertices_, file_bytes_);
      data_.vertices.push_back(vertex);
      all_valid_ = all_valid_ && IsValidVertex(vertex);
      return true;
    });
  }

  Status CheckVertices() {
    if (all_valid_) return {};
    const Result<std::optional<std::size_t>> invalid = FindInvalidVertex(data_, options_);
    if (!invalid.ok()) return invalid.error();
    if (!*invalid) return {};
    Status status = ForEachVertex([&](const Vec3d&, std::uint64_t i) { return i != **invalid; });
    return status.ok() ? Broken(WhyNotVertex(data_, **invalid)) : std::move(status);
  }

  Status EndsAfter(std::uint64_t read, std::uint64_t claimed, const char* what) const {
    return Broken("the file ends after " + std::to_string(read) + " of " + std::to_string(claimed) +
                  " " + what);
  }

  // Calls handle(corners) for each face, with the cursor after the number of its corners.
  template <class F>
  Status ForEachFace(F&& handle) {
    for (std::uint64_t i = 0; i < faces_; ++i) {
      if (cancel_.Spend(64)) return cancel_.ToError();
      if (!cursor_.FindLineWithWords()) return EndsAfter(i, faces_, "faces");
      const std::string_view word = cursor_.NextWord();
      const std::optional<std::int64_t> corners = ParseCount(word);
      if (!corners) return Broken(WhyNotInteger(word));
      if (*corners < 0)
        return Broken("a face cannot have " + std::to_string(*corners) + " corners");
      if (std::cmp_greater(*corners, cursor_.remaining() / 2)) {
        return Broken("a face of " + std::to_string(*corners) + " corners does not fit into the " +
                      std::to_string(cursor_.remaining()) + " bytes that follow");
      }
      if (Status status = handle(static_cast<std::uint64_t>(*corners)); !status.ok()) {
        return status;
      }
      cursor_.NextLine();
    }
    return {};
  }

  Status CountTriangles() {
    MeshCounts counts{.vertices = vertices_};
    Status status = ForEachFace([&](std::uint64_t corners) -> Status {
      for (std::uint64_t i = 0; i < corners; ++i) {
        if (NextWordOfRow().empty()) return Broken(WhyNotInteger({}));
        if (cancel_.Spend(64)) return cancel_.ToError();
      }
      counts.AddFace(corners);
      return {};
    });
    if (!status.ok()) return status;
    if (counts.triangles > kMaxTriangles) {
      return Error{ErrorCode::kMeshTooLarge,
                   "the OFF file has " + std::to_string(counts.triangles) + " triangles; at most " +
                       std::to_string(kMaxTriangles) + " are allowed"};
    }
    PlanAttributes(&counts);
    if (Status told = options_.Counted(counts); !told.ok()) return told;
    if (sink_ != nullptr) sink_->Plan(planned_);
    triangles_ = counts.triangles;
    corners_.reserve(counts.most_corners);
    return {};
  }

  Status ReadFaces() {
    return ForEachFace([&](std::uint64_t corners) -> Status {
      corners_.clear();
      for (std::uint64_t i = 0; i < corners; ++i) {
        const std::string_view word = NextWordOfRow();
        std::optional<std::int64_t> index = ParseCount(word);
        if (!index) index = ParseCount(cursor_.BeforeHash(word));
        if (!index) return Broken(WhyNotInteger(word));
        if (!IsVertexIndex(*index, data_.vertices.size()))
          return Broken(WhyNotVertexIndex(*index, data_.vertices.size()));
        corners_.push_back(static_cast<std::uint32_t>(*index));
        if (cancel_.Spend(64)) return cancel_.ToError();
      }
      MakeRoom(data_.triangles, triangles_, file_bytes_, corners_.size());
      Status status = cutter_.Add(corners_);
      if (!status.ok()) return AtLine(cursor_.line(), std::move(status).error());
      if (sink_ != nullptr) {
        AttributeSink::Face face{.vertices = corners_};
        // In free layouts too a colour is on the line of the last corner.
        if (planned_.has_face_colors) face.color = ReadColor(0, false);
        sink_->AddFace(face, &cancel_);
      }
      return {};
    });
  }

  const MeshReadOptions& options_;
  CancelPoll cancel_;
  TextCursor cursor_;
  TextCursor body_;  // after the counts
  std::size_t file_bytes_;
  bool has_keyword_ = false;
  std::uint64_t numbers_ = 3;  // of a vertex, as the keyword announces
  std::uint64_t vertices_ = 0;
  std::uint64_t triangles_ = 0;  // once the faces are counted
  std::uint64_t faces_ = 0;
  Layout layout_ = Layout::kEvenLines;
  MeshData data_;
  bool all_valid_ = true;  // the coordinates of all vertices
  AttributeSink* sink_;    // or null
  AttributeSink::Counts planned_;
  bool has_vertex_colors_ = false;  // and the sink takes them
  std::size_t color_begin_ = 3;     // number of the first of them among a vertex's numbers
  PolygonCutter cutter_;
  std::vector<std::uint32_t> corners_;
};

}  // namespace

Result<MeshData> ReadOff(std::span<const std::byte> bytes, const MeshReadOptions& options) {
  CancelPoll poll(options.cancel);
  const std::string_view text =
      WithoutPadding(SkipByteOrderMark(std::string_view(reinterpret_cast<const char*>(bytes.data()),
                                                        bytes.size())),
                     &poll);
  OffReader reader(text, options);
  Result<MeshData> mesh = reader.Read();
  if (!mesh.ok() && !reader.has_keyword() && IsOfTheFile(mesh.error()) && IsListOfPoints(text)) {
    return UnsupportedFormat(
        "a list of points, or an OFF file without its keyword (then " + mesh.error().message + ")",
        kNoFacesAdvice);
  }
  return mesh;
}

bool IsOffKeyword(std::string_view word) { return ParseKeyword(word).has_value(); }

}  // namespace kdray::core
