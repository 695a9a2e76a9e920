// SPDX-License-Identifier: Apache-2.0
// The rows of a PLY file, ascii or binary, with one interface for ply_reader.cc, which walks
// through a row property by property. Every call returns false when the file does not contain the
// requested value; error() then gives the cause and the position.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <utility>

#include "core/base/cancel.h"
#include "core/base/cancel_poll.h"
#include "core/base/result.h"
#include "core/io/parse_text.h"
#include "core/io/ply_header.h"

namespace kdray::core {

/// How rows are distributed over the lines of a text.
enum class PlyLayout : std::uint8_t {
  kEvenLines,  ///< one row a line, and nothing else
  kLines,      ///< one row a line; words after the last property are ignored, because some programs
               ///< write more than they declare
  kWords,      ///< rows on any lines; each element begins a line
  kWrapped,    ///< rows anywhere, as in text wrapped to some line length
};

/// Rows of text. Skips blank lines and remarks: lines with `comment` or `obj_info`, which some
/// programs write here too, and # with the rest of its line.
class PlyAsciiBody {
 public:
  static constexpr bool kIsText = true;

  /// `text`: the whole file. `poll`: as TextCursor takes it.
  PlyAsciiBody(std::string_view text, const PlyHeader& header, PlyLayout layout, CancelPoll* poll);

  /// Lower bound of the bytes of a row of this element.
  static std::size_t LeastBytes(const PlyElement& element) { return 2 * element.properties.size(); }
  std::size_t remaining() const { return cursor_.remaining(); }

  bool BeginRow();
  bool EndRow();
  /// Call after the last row of an element.
  bool EndElement();
  /// Whether faces may have fewer than three corners: only where lines separate rows. Elsewhere
  /// such a face is a sign of a missing number, after which rows are read from the wrong position.
  bool AllowsShortFaces() const { return !IsFree(); }
  bool ReadNumber(PlyType type, double* value);
  /// The length of a list, checked against the remaining bytes.
  bool ReadLength(const PlyProperty& list, std::uint64_t* length);
  bool ReadIndex(PlyType type, std::int64_t* index);
  bool Skip(const PlyProperty& property);
  bool SkipItems(PlyType type, std::uint64_t count);

  /// Makes `cause` the error, at the value that was read last; false.
  bool Fail(Error cause);
  const Error& error() const { return error_; }

  /// The text of the value that was read last.
  std::string_view word() const { return word_; }
  /// Whether no value is left.
  bool AtEnd() { return NextValue().empty(); }

 private:
  bool Fail(std::string cause) { return Fail(Error{ErrorCode::kInvalidMesh, std::move(cause)}); }
  bool IsFree() const { return layout_ == PlyLayout::kWords || layout_ == PlyLayout::kWrapped; }
  // The next word of the row; empty at the row's end.
  std::string_view NextValue();

  TextCursor cursor_;
  PlyLayout layout_;
  std::string_view word_;
  Error error_;
};

struct PlyLines {
  std::uint64_t count = 0;
  bool even = true;  ///< all except the last have the same number of words, as in wrapped text
};

/// Counts the lines of the body with words, without remarks, up to `most` lines. Also kCancelled
/// and kDeadlineExceeded.
Result<PlyLines> CountPlyLines(std::string_view text, const PlyHeader& header, std::uint64_t most,
                               const CancelToken& cancel);

/// Rows of bytes, in either order.
class PlyBinaryBody {
 public:
  static constexpr bool kIsText = false;

  PlyBinaryBody(std::string_view bytes, const PlyHeader& header);

  static std::size_t LeastBytes(const PlyElement& element);
  std::size_t remaining() const { return bytes_.size() - position_; }

  bool BeginRow() { return true; }
  bool EndRow() { return true; }
  bool EndElement() { return true; }
  bool AllowsShortFaces() const { return true; }
  bool ReadNumber(PlyType type, double* value);
  bool ReadLength(const PlyProperty& list, std::uint64_t* length);
  bool ReadIndex(PlyType type, std::int64_t* index);
  bool Skip(const PlyProperty& property);
  bool SkipItems(PlyType type, std::uint64_t count);

  bool Fail(Error cause);
  const Error& error() const { return error_; }

 private:
  bool Fail(std::string cause) { return Fail(Error{ErrorCode::kInvalidMesh, std::move(cause)}); }
  // The value of that type at the position; the bytes must be there.
  template <class T>
  T Take();
  bool Has(std::uint64_t bytes) {
    last_ = position_;
    return bytes <= remaining() || FailTooShort(bytes);
  }
  bool FailTooShort(std::uint64_t bytes);

  std::string_view bytes_;
  bool swap_;
  std::size_t position_;
  std::size_t last_;  // where the last value began
  Error error_;
};

}  // namespace kdray::core
