#include "core/io/off_reader.h"

#include <algorithm>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/base/cancel_poll.h"
#include "core/io/claimed_rows.h"
#include "core/io/mesh_error.h"
#include "core/io/parse_text.h"
#include "core/io/polygon.h"

namespace kdray::core {
namespace {

struct Keyword {
  bool has_other_dimension = false;
  std::string_view rest;  // glued to it: "8" of "OFF8"
};

std::optional<Keyword> ParseKeyword(std::string_view word) {
  Keyword keyword;
  const auto pass = [&](std::string_view prefix) {
    if (!word.starts_with(prefix)) return false;
    word.remove_prefix(prefix.size());
    return true;
  };
  pass("ST");
  pass("C");
  pass("N");
  const bool four = pass("4");
  const bool any = pass("n");
  keyword.has_other_dimension = four || any;
  if (!pass("OFF")) return std::nullopt;
  if (!std::all_of(word.begin(), word.end(), [](char c) { return c >= '0' && c <= '9'; })) {
    return std::nullopt;
  }
  keyword.rest = word;
  return keyword;
}

class OffReader {
 public:
  OffReader(std::string_view text, const MeshReadOptions& options)
      : cursor_(text, {.hash_comments = true}),
        file_bytes_(text.size()),
        cancel_(options.cancel),
        cutter_(&data_, options.cancel) {
    data_.format = MeshFormat::kOff;
  }

  Result<MeshData> Read() {
    if (Status status = ReadCounts(); !status.ok()) return std::move(status).error();
    if (faces_ == 0) return Error{ErrorCode::kEmptyMesh, "the OFF file has no face"};
    if (Status status = ReadVertices(); !status.ok()) return std::move(status).error();
    const TextCursor first_face = cursor_;
    if (Status status = CountTriangles(); !status.ok()) return std::move(status).error();
    cursor_ = first_face;
    if (Status status = ReadFaces(); !status.ok()) return std::move(status).error();
    if (data_.triangles.empty()) {
      return Error{ErrorCode::kEmptyMesh, "the OFF file has no face with three or more corners"};
    }
    return std::move(data_);
  }

 private:
  Error Broken(std::string_view cause) const { return AtLine(cursor_.line(), cause); }

  Status ReadCounts() {
    if (!cursor_.FindLineWithWords()) return Broken("the OFF file has no counts");
    std::string_view word = cursor_.NextWord();
    if (const std::optional<Keyword> keyword = ParseKeyword(word)) {
      word = keyword->rest.empty() ? cursor_.NextWord() : keyword->rest;
      if (keyword->has_other_dimension || word == "BINARY") {
        Error error = Broken("of OFF only ascii files with three coordinates are read");
        error.code = ErrorCode::kUnsupportedMeshFormat;
        return error;
      }
      if (word.empty()) {
        if (!cursor_.FindLineWithWords()) return Broken("the OFF file has no counts");
        word = cursor_.NextWord();
      }
    }
    for (std::uint64_t* count : {&vertices_, &faces_}) {
      const std::optional<std::int64_t> number = ParseInteger(word);
      if (!number) return Broken(WhyNotInteger(word));
      if (*number < 0) return Broken(Quoted(word) + " is not a count");
      *count = static_cast<std::uint64_t>(*number);
      if (count == &vertices_) word = cursor_.NextWord();
    }
    return CheckClaims();
  }

  // The shortest lines of a vertex and a face are "0 0 0" and "0"; the last one may lack its end.
  Status CheckClaims() {
    const std::uint64_t left = cursor_.remaining() + 1;
    if (vertices_ > left / 6 || faces_ > (left - 6 * vertices_) / 2) {
      return Broken(std::to_string(vertices_) + " vertices and " + std::to_string(faces_) +
                    " faces do not fit into the " + std::to_string(cursor_.remaining()) +
                    " bytes that are left");
    }
    if (vertices_ > kMaxVertices) {
      return Error{ErrorCode::kMeshTooLarge, "the OFF file has " + std::to_string(vertices_) +
                                                 " vertices; at most " +
                                                 std::to_string(kMaxVertices) + " are allowed"};
    }
    cursor_.NextLine();
    return {};
  }

  Status ReadVertices() {
    for (std::uint64_t i = 0; i < vertices_; ++i) {
      if (cancel_.Spend(64)) return cancel_.ToError();
      if (!cursor_.FindLineWithWords()) return EndsAfter(i, vertices_, "vertices");
      Vec3d vertex;
      for (int axis = 0; axis < 3; ++axis) {
        const std::string_view word = cursor_.NextWord();
        const std::optional<double> number = ParseNumber(word);
        if (!number) return Broken(WhyNotNumber(word));
        vertex[axis] = *number;
      }
      MakeRoom(data_.vertices, vertices_, file_bytes_);
      data_.vertices.push_back(vertex);
      cursor_.NextLine();
    }
    return {};
  }

  Status EndsAfter(std::uint64_t read, std::uint64_t claimed, const char* what) const {
    return Broken("the file ends after " + std::to_string(read) + " of " + std::to_string(claimed) +
                  " " + what);
  }

  // Calls handle(corners) for each face, the cursor behind the number of its corners.
  template <class F>
  Status ForEachFace(F&& handle) {
    for (std::uint64_t i = 0; i < faces_; ++i) {
      if (cancel_.Spend(64)) return cancel_.ToError();
      if (!cursor_.FindLineWithWords()) return EndsAfter(i, faces_, "faces");
      const std::string_view word = cursor_.NextWord();
      const std::optional<std::int64_t> corners = ParseInteger(word);
      if (!corners) return Broken(WhyNotInteger(word));
      if (*corners < 0)
        return Broken("a face cannot have " + std::to_string(*corners) + " corners");
      if (std::cmp_greater(*corners, cursor_.remaining() / 2)) {
        return Broken("a face of " + std::to_string(*corners) + " corners does not fit into the " +
                      std::to_string(cursor_.remaining()) + " bytes that are left");
      }
      if (Status status = handle(static_cast<std::uint64_t>(*corners)); !status.ok()) {
        return status;
      }
      cursor_.NextLine();
    }
    return {};
  }

  Status CountTriangles() {
    std::uint64_t triangles = 0;
    std::uint64_t most_corners = 0;
    Status status = ForEachFace([&](std::uint64_t corners) -> Status {
      for (std::uint64_t i = 0; i < corners; ++i) {
        if (cursor_.NextWord().empty()) return Broken(WhyNotInteger({}));
      }
      triangles += corners < 3 ? 0 : corners - 2;
      most_corners = std::max(most_corners, corners);
      return {};
    });
    if (!status.ok()) return status;
    if (triangles > kMaxTriangles) {
      return Error{ErrorCode::kMeshTooLarge, "the OFF file has " + std::to_string(triangles) +
                                                 " triangles; at most " +
                                                 std::to_string(kMaxTriangles) + " are allowed"};
    }
    data_.triangles.reserve(triangles);
    corners_.reserve(most_corners);
    return {};
  }

  Status ReadFaces() {
    return ForEachFace([&](std::uint64_t corners) -> Status {
      corners_.clear();
      for (std::uint64_t i = 0; i < corners; ++i) {
        const std::string_view word = cursor_.NextWord();
        const std::optional<std::int64_t> index = ParseInteger(word);
        if (!index) return Broken(WhyNotInteger(word));
        if (*index < 0 || std::cmp_greater_equal(*index, data_.vertices.size())) {
          return Broken("vertex " + std::to_string(*index) + " does not exist; the file has " +
                        std::to_string(data_.vertices.size()) + ", counted from 0");
        }
        corners_.push_back(static_cast<std::uint32_t>(*index));
      }
      Status status = cutter_.Add(corners_);
      if (!status.ok()) return AtLine(cursor_.line(), std::move(status).error());
      return {};
    });
  }

  TextCursor cursor_;
  std::size_t file_bytes_;
  CancelPoll cancel_;
  std::uint64_t vertices_ = 0;
  std::uint64_t faces_ = 0;
  MeshData data_;
  PolygonCutter cutter_;
  std::vector<std::uint32_t> corners_;
};

}  // namespace

Result<MeshData> ReadOff(std::span<const std::byte> bytes, const MeshReadOptions& options) {
  const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  return OffReader(SkipByteOrderMark(text), options).Read();
}

bool IsOffKeyword(std::string_view word) { return ParseKeyword(word).has_value(); }

}  // namespace kdray::core
