// The rows behind a PLY header, ascii or binary, behind one interface for ply_reader.cc: it walks
// through a row property by property. Every call returns false when the file cannot hold what it is
// asked for; error() then says what and where.
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

/// How the rows of a text stand on its lines.
enum class PlyLayout : std::uint8_t {
  kEvenLines,  ///< a row a line, and nothing more on it
  kLines,      ///< a row a line; words behind the last property are ignored, since some programs
               ///< write more than they declare
  kWords,      ///< rows on any lines; only each element begins a line
  kWrapped,    ///< rows anywhere, as when a text is wrapped to lines of some length
};

/// Rows of text. Blank lines are skipped, and remarks: `comment` and `obj_info`, which some
/// programs write here too, and # with what is behind it on the line.
class PlyAsciiBody {
 public:
  static constexpr bool kIsText = true;

  /// `text`: the whole file. `poll`: as TextCursor takes it.
  PlyAsciiBody(std::string_view text, const PlyHeader& header, PlyLayout layout, CancelPoll* poll);

  /// The least bytes that a row of this element takes.
  static std::size_t LeastBytes(const PlyElement& element) { return 2 * element.properties.size(); }
  std::size_t remaining() const { return cursor_.remaining(); }

  bool BeginRow();
  bool EndRow();
  /// Behind the last row of an element.
  bool EndElement();
  /// A face with fewer than three corners, where rows are told by their lines. Elsewhere it is a
  /// sign of a number that lacks: the rows behind it are then read in the wrong places.
  bool AllowsShortFaces() const { return !IsFree(); }
  bool ReadNumber(PlyType type, double* value);
  /// The length of a list, checked against the bytes that are left.
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
  // The next word of the row; empty at its end.
  std::string_view NextValue();

  TextCursor cursor_;
  PlyLayout layout_;
  std::string_view word_;
  Error error_;
};

struct PlyLines {
  std::uint64_t count = 0;
  bool even = true;  ///< all but the last have equally many words, as when a text is wrapped
};

/// The lines of the body that hold words, remarks left out; looks no further than `most` lines.
/// Also kCancelled and kDeadlineExceeded.
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
