// The rows behind a PLY header, ascii or binary, behind one interface for ply_reader.cc: it walks
// through a row property by property. Every call returns false when the file cannot hold what it is
// asked for; error() then says what and where.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <utility>

#include "core/base/result.h"
#include "core/io/parse_text.h"
#include "core/io/ply_header.h"

namespace kdray::core {

/// Rows of text: one line a row, blank lines between them skipped. Words behind the last property
/// are ignored (some programs write more than they declare).
class PlyAsciiBody {
 public:
  /// `text`: the whole file.
  PlyAsciiBody(std::string_view text, const PlyHeader& header);

  /// The least bytes that a row of this element takes.
  static std::size_t LeastBytes(const PlyElement& element) { return 2 * element.properties.size(); }
  std::size_t remaining() const { return cursor_.remaining(); }

  bool BeginRow();
  bool EndRow();
  bool ReadNumber(PlyType type, double* value);
  /// The length of a list, checked against the bytes that are left.
  bool ReadLength(const PlyProperty& list, std::uint64_t* length);
  bool ReadIndex(PlyType type, std::int64_t* index);
  bool Skip(const PlyProperty& property);
  bool SkipItems(PlyType type, std::uint64_t count);

  /// Makes `cause` the error, at the value that was read last; false.
  bool Fail(Error cause);
  const Error& error() const { return error_; }

 private:
  bool Fail(std::string cause) { return Fail(Error{ErrorCode::kInvalidMesh, std::move(cause)}); }

  TextCursor cursor_;
  Error error_;
};

/// Rows of bytes, in either order.
class PlyBinaryBody {
 public:
  PlyBinaryBody(std::string_view bytes, const PlyHeader& header);

  static std::size_t LeastBytes(const PlyElement& element);
  std::size_t remaining() const { return bytes_.size() - position_; }

  bool BeginRow() { return true; }
  bool EndRow() { return true; }
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
