// SPDX-License-Identifier: Apache-2.0
#include "core/io/stl_reader.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <cstring>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "core/base/cancel_poll.h"
#include "core/io/attribute_sink.h"
#include "core/io/mesh_error.h"
#include "core/io/parse_text.h"
#include "core/io/vertex_check.h"

namespace kdray::core {
namespace {

// A binary file: 80 arbitrary bytes, the number of triangles, and for each the normal, three
// corners and two bytes of attributes, all little-endian.
constexpr std::size_t kHeaderBytes = 80;
constexpr std::size_t kFirstRecord = 84;
constexpr std::size_t kRecordBytes = 50;
constexpr std::size_t kNormalBytes = 12;
constexpr std::size_t kAttributeBytes = 2;

std::uint32_t LoadUint32(std::span<const std::byte> bytes, std::size_t offset) {
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < 4; ++i) {
    value |= static_cast<std::uint32_t>(bytes[offset + i]) << (8 * i);
  }
  return value;
}

std::uint64_t BinarySize(std::span<const std::byte> bytes) {
  return kFirstRecord + std::uint64_t{kRecordBytes} * LoadUint32(bytes, kHeaderBytes);
}

void AppendTriangle(MeshData* data) {
  const auto end = static_cast<std::uint32_t>(data->vertices.size());
  data->triangles.push_back({end - 3, end - 2, end - 1});
}

Error TooLarge(std::uint64_t triangles) {
  return Error{ErrorCode::kMeshTooLarge, "the STL file has " + std::to_string(triangles) +
                                             " triangles; at most " +
                                             std::to_string(kMaxTriangles) + " are allowed"};
}

// The number of records: the count, if only NUL bytes follow the records; or, if the count is 0,
// the number by size (some programs write the count last, or never). nullopt if count and size
// contradict each other.
std::optional<std::uint32_t> CountRecords(std::span<const std::byte> bytes, CancelPoll* poll) {
  const std::uint32_t count = LoadUint32(bytes, kHeaderBytes);
  const std::uint64_t records = bytes.size() - kFirstRecord;
  if (count == 0) {
    const bool whole = records % kRecordBytes == 0 && records / kRecordBytes <= kMaxTriangles;
    return whole ? std::optional(static_cast<std::uint32_t>(records / kRecordBytes)) : std::nullopt;
  }
  if (BinarySize(bytes) > bytes.size()) return std::nullopt;
  const auto tail = bytes.subspan(static_cast<std::size_t>(BinarySize(bytes)));
  bool nothing = true;
  PolledLoop(tail.size(), 1, poll,
             [&](std::size_t i) { nothing = nothing && tail[i] == std::byte{0}; });
  return nothing ? std::optional(count) : std::nullopt;
}

Error WrongSize(std::span<const std::byte> bytes) {
  return AtByte(kHeaderBytes, "as a binary STL, with a count of " +
                                  std::to_string(LoadUint32(bytes, kHeaderBytes)) +
                                  " triangles, the file would have " +
                                  std::to_string(BinarySize(bytes)) + " bytes; it has " +
                                  std::to_string(bytes.size()));
}

// Each triangle has vertices of its own.
MeshCounts CountsOf(std::uint64_t triangles) {
  return {.vertices = 3 * triangles, .triangles = triangles};
}

// The same with the memory of groups, which only solids of text are.
MeshCounts CountsOf(std::uint64_t triangles, std::uint64_t solids, AttributeSink* sink) {
  MeshCounts counts = CountsOf(triangles);
  if (sink != nullptr) {
    counts.other_bytes = sink->PlannedBytes({.triangles = triangles, .groups = solids});
  }
  return counts;
}

Result<MeshData> ReadBinary(std::span<const std::byte> bytes, const MeshReadOptions& options) {
  CancelPoll cancel(options.cancel);
  const std::optional<std::uint32_t> count = CountRecords(bytes, &cancel);
  if (cancel.stopped()) return cancel.ToError();
  if (!count) return WrongSize(bytes);
  if (*count == 0) return Error{ErrorCode::kEmptyMesh, "the STL file has no triangle"};
  if (*count > kMaxTriangles) return TooLarge(*count);
  if (Status told = options.Counted(CountsOf(*count)); !told.ok()) return std::move(told).error();
  if (options.attributes != nullptr) options.attributes->Begin();
  MeshData data;
  data.format = MeshFormat::kStl;
  data.single_precision = true;
  data.vertices.reserve(3 * std::size_t{*count});
  data.triangles.reserve(*count);
  std::size_t offset = kFirstRecord;
  for (std::uint32_t record = 0; record < *count; ++record) {
    if (cancel.Spend(64)) return cancel.ToError();
    offset += kNormalBytes;
    for (int corner = 0; corner < 3; ++corner) {
      Vec3f vertex;
      for (int axis = 0; axis < 3; ++axis, offset += 4) {
        vertex[axis] = std::bit_cast<float>(LoadUint32(bytes, offset));
        if (!IsValidCoordinate(static_cast<double>(vertex[axis]))) {
          return AtByte(offset, WhyNotCoordinate(static_cast<double>(vertex[axis])));
        }
      }
      data.vertices.push_back(Vec3d(vertex));
    }
    AppendTriangle(&data);
    offset += kAttributeBytes;
  }
  return data;
}

class AsciiReader {
 public:
  AsciiReader(std::string_view text, const MeshReadOptions& options)
      : text_(text), options_(options), cancel_(options.cancel), cursor_(text, {}, 1, &cancel_) {
    data_.format = MeshFormat::kStl;
  }

  Result<MeshData> Read() {
    const std::size_t facets = std::min(MostFacets(), kMaxTriangles);
    if (cancel_.stopped()) return cancel_.ToError();
    // Each group has a facet.
    const MeshCounts counts = CountsOf(facets, facets, options_.attributes);
    if (Status told = options_.Counted(counts); !told.ok()) return std::move(told).error();
    if (options_.attributes != nullptr) {
      options_.attributes->Begin();
      options_.attributes->Plan({.triangles = facets, .groups = facets});
    }
    data_.vertices.reserve(3 * facets);
    data_.triangles.reserve(facets);
    for (;;) {
      if (cancel_.Spend(64)) return cancel_.ToError();
      const std::string_view word = NextWord();
      if (word.empty()) break;
      if (EqualsIgnoringCase(word, "facet")) {
        if (Status status = ReadFacet(); !status.ok()) return std::move(status).error();
      } else if (BeginsOrEndsSolid(word)) {
        PassName(word);
      } else if (word_begins_line_) {
        return AtLine(cursor_.line(), Quoted(word) + " does not begin a statement of an STL file");
      }
    }
    if (data_.triangles.empty()) {
      return Error{ErrorCode::kEmptyMesh, "the STL file has no facet"};
    }
    return std::move(data_);
  }

 private:
  // Upper bound: a facet has three words `vertex`, and a minimum length.
  std::size_t MostFacets() {
    constexpr std::string_view kShortest =
        "facet outerloop vertex 0 0 0 vertex 0 0 0 vertex 0 0 0 endloop endfacet ";
    constexpr std::string_view kVertex = "vertex";
    std::size_t vertices = 0;
    PolledLoop(text_.size(), 1, &cancel_, [&](std::size_t i) {
      if ((text_[i] | 0x20) != 'v') return;
      if (EqualsIgnoringCase(text_.substr(i, kVertex.size()), kVertex)) ++vertices;
    });
    return std::min(vertices / 3, (text_.size() + 1) / kShortest.size());
  }

  // The next word on this or a later line; empty at the end of the file. Lines with a remark or a
  // colour, which some programs add anywhere, are skipped.
  std::string_view NextWord() {
    for (;;) {
      const std::string_view word = cursor_.NextWord();
      if (word.empty()) {
        if (cursor_.AtEnd()) return word;
        cursor_.NextLine();
        begins_line_ = true;
        continue;
      }
      if (!begins_line_ || !IsRemark(word)) {
        word_begins_line_ = std::exchange(begins_line_, false);
        return word;
      }
      cursor_.NextLine();
    }
  }

  static bool IsRemark(std::string_view word) {
    switch (word.front()) {
      case '#':
      case '$':
      case ';':
        return true;
      case '/':
        return word.starts_with("//");
      default:
        return EqualsIgnoringCase(word, "color") || EqualsIgnoringCase(word, "colour");
    }
  }

  // Whether the word begins or ends a solid; the name may be attached to it, and an end may be two
  // words.
  bool BeginsOrEndsSolid(std::string_view word) {
    if (EqualsIgnoringCase(word, "solid") || EqualsIgnoringCase(word, "endsolid")) return true;
    if (EqualsIgnoringCase(word, "end")) {
      TextCursor ahead = cursor_;
      return EqualsIgnoringCase(ahead.NextWord(), "solid");
    }
    return word_begins_line_ &&
           (StartsIgnoringCase(word, "endsolid") || StartsIgnoringCase(word, "solid"));
  }

  // A name ends with its line, or where a facet begins if the file is one line. `keyword`: what
  // precedes it; an attached name is part of it.
  void PassName(std::string_view keyword) {
    constexpr std::string_view kSolid = "solid";
    std::string_view name = keyword.substr(std::min(kSolid.size(), keyword.size()));
    for (;;) {
      TextCursor ahead = cursor_;
      const std::string_view word = ahead.NextWord();
      if (word.empty()) break;
      if (EqualsIgnoringCase(word, "facet") && BeginsLoop(ahead)) break;
      cursor_.NextWord();
      const char* const first = name.empty() ? word.data() : name.data();
      name = {first, static_cast<std::size_t>(word.data() + word.size() - first)};
    }
    if (options_.attributes == nullptr) return;
    if (StartsIgnoringCase(keyword, kSolid)) {
      options_.attributes->StartGroup(name);
    } else {
      options_.attributes->EndGroup();
    }
  }

  // Whether a facet's loop follows at the cursor, with or without a normal; a name may also contain
  // the words "facet normal".
  static bool BeginsLoop(TextCursor cursor) {
    std::string_view word = cursor.NextWordOnAnyLine();
    if (EqualsIgnoringCase(word, "normal")) {
      for (int axis = 0; axis < 3; ++axis) cursor.NextWord();
      word = cursor.NextWordOnAnyLine();
    }
    return EqualsIgnoringCase(word, "outer") || EqualsIgnoringCase(word, "outerloop");
  }

  static bool IsKeyword(std::string_view word) {
    static constexpr std::array<std::string_view, 10> kKeywords = {
        "solid",  "facet",   "normal",   "outer",    "loop",
        "vertex", "endloop", "endfacet", "endsolid", "end"};
    return std::any_of(kKeywords.begin(), kKeywords.end(),
                       [&](std::string_view k) { return EqualsIgnoringCase(word, k); });
  }

  // Whether the word, or the word with the next one, is the keyword, which may be one word or two;
  // skips both.
  bool Is(std::string_view word, std::string_view keyword, std::string_view first_half) {
    if (EqualsIgnoringCase(word, keyword)) return true;
    if (first_half.empty()) return false;
    std::string_view second_half = keyword.substr(first_half.size());
    if (second_half.starts_with(' ')) second_half.remove_prefix(1);
    if (StartsIgnoringCase(word, first_half) &&
        EqualsIgnoringCase(word.substr(first_half.size()), second_half)) {
      return true;
    }
    if (!EqualsIgnoringCase(word, first_half)) return false;
    TextCursor ahead = cursor_;
    if (!EqualsIgnoringCase(ahead.NextWord(), second_half)) return false;
    cursor_ = ahead;
    return true;
  }

  // Skips the keyword that must come next. Other words may precede it on the previous statement's
  // line: the numbers of a normal, or remarks. `first_half`: of a keyword that may be two words.
  Status Expect(std::string_view keyword, std::string_view first_half = {}) {
    for (;;) {
      const std::string_view word = NextWord();
      if (word.empty()) {
        return AtLine(cursor_.line(), "the file ends where '" + std::string(keyword) + "' must be");
      }
      if (Is(word, keyword, first_half)) return {};
      if (!word_begins_line_ && !IsKeyword(word)) continue;
      if (EqualsIgnoringCase(word, "normal") && !has_normal_) {
        has_normal_ = true;
        continue;
      }
      return AtLine(cursor_.line(), Quoted(word) + " where '" + std::string(keyword) + "' must be");
    }
  }

  Status ReadFacet() {
    if (data_.triangles.size() == kMaxTriangles) return TooLarge(kMaxTriangles + 1);
    has_normal_ = false;
    if (Status status = Expect("outer loop", "outer"); !status.ok()) return status;
    has_normal_ = true;
    for (int corner = 0; corner < 3; ++corner) {
      if (Status status = Expect("vertex"); !status.ok()) return status;
      Vec3d vertex;
      for (int axis = 0; axis < 3; ++axis) {
        const std::string_view word = cursor_.NextWord();
        const std::optional<double> number = ParseCoordinate(word);
        if (!number) return AtLine(cursor_.line(), WhyNotNumber(word));
        if (!IsValidCoordinate(*number)) {
          return AtLine(cursor_.line(), WhyNotCoordinate(*number, word));
        }
        vertex[axis] = *number;
      }
      data_.vertices.push_back(vertex);
    }
    AppendTriangle(&data_);
    if (options_.attributes != nullptr) {
      options_.attributes->AddTriangle({.vertices = data_.triangles.back()});
    }
    if (Status status = Expect("endloop", "end"); !status.ok()) return status;
    return Expect("endfacet", "end");
  }

  std::string_view text_;
  const MeshReadOptions& options_;
  bool begins_line_ = true;        // the cursor is before a line's first word
  bool word_begins_line_ = false;  // the last word was the first of its line
  bool has_normal_ = true;         // the facet has one already, or can no longer have one
  CancelPoll cancel_;
  TextCursor cursor_;
  MeshData data_;
};

// Whether a file whose size does not match its count is text, by its first 84 bytes. A count of at
// most 16 million has a byte 0.
bool BeginsAsText(std::string_view head) {
  if (head.find('\0') != std::string_view::npos) return false;
  TextCursor cursor(head, {});
  if (cursor.FindLineWithWords() && StartsIgnoringCase(cursor.NextWord(), "solid")) return true;
  return std::all_of(head.begin(), head.end(), [](char c) {
    const auto byte = static_cast<unsigned char>(c);
    return byte >= '\t' && byte < 0xf8;
  });
}

}  // namespace

bool HasBinaryStlSize(std::span<const std::byte> bytes) {
  return bytes.size() >= kFirstRecord && bytes.size() == BinarySize(bytes);
}

Result<MeshData> ReadStl(std::span<const std::byte> bytes, const MeshReadOptions& options) {
  if (HasBinaryStlSize(bytes)) return ReadBinary(bytes, options);
  const std::string_view text = SkipByteOrderMark(
      std::string_view(reinterpret_cast<const char*>(bytes.data()), bytes.size()));
  if (BeginsAsText(text.substr(0, kFirstRecord))) {
    CancelPoll poll(options.cancel);
    return AsciiReader(WithoutPadding(text, &poll), options).Read();
  }
  if (bytes.size() < kFirstRecord) {
    return AtByte(bytes.size(), "a binary STL file has at least 84 bytes");
  }
  return ReadBinary(bytes, options);
}

}  // namespace kdray::core
