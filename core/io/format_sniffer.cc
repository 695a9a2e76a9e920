// SPDX-License-Identifier: Apache-2.0
#include "core/io/format_sniffer.h"

#include <algorithm>
#include <cstddef>
#include <span>
#include <string>

#include "core/base/enumerators.h"
#include "core/io/foreign_files.h"
#include "core/io/gltf_container.h"
#include "core/io/mesh_error.h"
#include "core/io/obj_reader.h"
#include "core/io/off_reader.h"
#include "core/io/parse_text.h"
#include "core/io/stl_reader.h"

namespace kdray::core {
namespace {

// If the first statement does not identify the format, this part of the text is searched for a line
// that does.
constexpr std::size_t kLookBytes = 1 << 20;
constexpr std::size_t kHeadBytes = 84;  // of a binary STL: its header and its count

bool IsCount(std::string_view word) {
  const std::optional<std::int64_t> number = ParseCount(word);
  return number && *number >= 0;
}

// The format by the first statement; `cursor` is before it.
std::optional<MeshFormat> FindByFirstStatement(TextCursor cursor) {
  const std::string_view first = cursor.NextWord();
  if (EqualsIgnoringCase(first, "solid")) return MeshFormat::kStl;
  if (IsOffKeyword(first)) return MeshFormat::kOff;
  if (IsObjKeyword(first)) return MeshFormat::kObj;
  // OFF without its keyword begins with three counts.
  if (IsCount(first) && IsCount(cursor.NextWord()) && IsCount(cursor.NextWord()) &&
      cursor.NextWord().empty()) {
    return MeshFormat::kOff;
  }
  return std::nullopt;
}

// The corner of an OBJ face begins with a number that is not 0.
bool IsCorner(std::string_view word) {
  const std::optional<std::int64_t> number = ParseInteger(word.substr(0, word.find('/')));
  return number && *number != 0;
}

template <class F>
bool AreNextThree(TextCursor& cursor, F&& is) {
  return is(cursor.NextWord()) && is(cursor.NextWord()) && is(cursor.NextWord());
}

// The format by the first line that only one format can have.
std::optional<MeshFormat> FindByAnyStatement(std::string_view text) {
  TextCursor cursor(text.substr(0, kLookBytes), {.hash_comments = true});
  for (; cursor.FindLineWithWords(); cursor.NextLine()) {
    const std::string_view word = cursor.NextWord();
    if (word == "v" &&
        AreNextThree(cursor, [](auto w) { return ParseCoordinate(w).has_value(); })) {
      return MeshFormat::kObj;
    }
    if (word == "f" && AreNextThree(cursor, IsCorner)) return MeshFormat::kObj;
    if (EqualsIgnoringCase(word, "facet") || EqualsIgnoringCase(word, "solid")) {
      return MeshFormat::kStl;
    }
  }
  return std::nullopt;
}

// Bytes that no UTF-8 text contains.
bool IsBinary(std::string_view bytes) {
  return std::any_of(bytes.begin(), bytes.end(), [](char c) {
    const auto byte = static_cast<unsigned char>(c);
    return byte >= 0xf8 || (byte < ' ' && (byte < '\t' || byte > '\r'));
  });
}

Error Unknown(std::string_view all, std::string_view text, CancelPoll* poll) {
  if (IsListOfPoints(text)) {
    return UnsupportedFormat("a list of points", kNoFacesAdvice);
  }
  if (const std::optional<ForeignFile> foreign = FindForeignText(text)) {
    return UnsupportedFormat(foreign->name, foreign->advice);
  }
  if (!IsBinary(all.substr(0, kHeadBytes)) && HasLostItsLineBreaks(text, poll)) {
    return UnsupportedFormat("in no known format", kLineBreaksAdvice);
  }
  constexpr std::size_t kQuotedBytes = 80;  // more than Quoted shows
  all = all.substr(0, kQuotedBytes);
  const std::string_view first = all.substr(0, std::min(all.find_first_of("\r\n"), all.size()));
  return UnsupportedFormat("in no known format (they begin with " + Quoted(first) + ")");
}

}  // namespace

Error UnsupportedFormat(std::string_view what, std::string_view advice) {
  std::string message = "the bytes are " + std::string(what);
  if (!advice.empty()) message += "; " + std::string(advice);
  message += "; the formats are ";
  for (const MeshFormat format : kAll<MeshFormat>) {
    if (format != kAll<MeshFormat>.front()) message += ", ";
    message += Name(format);
  }
  return Error{ErrorCode::kUnsupportedMeshFormat, message};
}

Result<MeshFormat> FindFormat(std::string_view bytes, CancelPoll* poll) {
  // Checked first, because the header of a binary STL may look like any other format.
  if (HasBinaryStlSize(std::as_bytes(std::span(bytes)))) return MeshFormat::kStl;
  if (IsGlb(bytes)) return MeshFormat::kGlb;
  if (BeginsAsJsonObject(bytes)) return MeshFormat::kGltf;
  if (const std::optional<ForeignFile> foreign = FindForeignFile(bytes)) {
    return UnsupportedFormat(foreign->name, foreign->advice);
  }
  const std::string_view text = WithoutPadding(SkipByteOrderMark(bytes), poll);
  if (text.starts_with("ply") && (text.size() == 3 || text[3] <= ' ')) return MeshFormat::kPly;
  if (text.starts_with("plyformat") || text.starts_with("plycomment")) {
    return UnsupportedFormat("a PLY file without its line breaks", kLineBreaksAdvice);
  }

  TextCursor cursor(text, {.hash_comments = true}, 1, poll);
  if (!cursor.FindLineWithWords()) {
    std::string message = "the mesh contains only blanks and comments";
    if (HasLostItsLineBreaks(text, poll)) message += "; " + std::string(kLineBreaksAdvice);
    return Error{ErrorCode::kEmptyMesh, message};
  }
  if (const std::optional<MeshFormat> format = FindByFirstStatement(cursor)) return *format;
  // Bytes that are not text and not recognised can only be a binary STL with a wrong count.
  if (IsBinary(bytes.substr(0, kHeadBytes))) {
    return bytes.size() >= kHeadBytes ? Result<MeshFormat>(MeshFormat::kStl)
                                      : Unknown(bytes, text, poll);
  }
  if (const std::optional<MeshFormat> format = FindByAnyStatement(text)) return *format;
  return Unknown(bytes, text, poll);
}

}  // namespace kdray::core
