// SPDX-License-Identifier: Apache-2.0
#include "core/io/mesh_error.h"

#include "core/base/hex.h"

namespace kdray::core {

namespace {

bool HasPlace(const Error& error) {
  return error.code != ErrorCode::kCancelled && error.code != ErrorCode::kDeadlineExceeded;
}

}  // namespace

Error AtLine(std::uint64_t line, Error error) {
  if (!HasPlace(error)) return error;
  error.message = "line " + std::to_string(line) + ": " + error.message;
  error.line = line;
  return error;
}

Error AtByte(std::uint64_t byte, Error error) {
  if (!HasPlace(error)) return error;
  error.message = "byte " + std::to_string(byte) + ": " + error.message;
  error.byte = byte;
  return error;
}

Error AtLine(std::uint64_t line, std::string_view cause) {
  return AtLine(line, Error{ErrorCode::kInvalidMesh, std::string(cause)});
}

Error AtByte(std::uint64_t byte, std::string_view cause) {
  return AtByte(byte, Error{ErrorCode::kInvalidMesh, std::string(cause)});
}

bool IsOfTheFile(const Error& error) {
  return error.code == ErrorCode::kInvalidMesh || error.code == ErrorCode::kEmptyMesh;
}

std::string Quoted(std::string_view piece) {
  constexpr std::size_t kLongest = 40;
  std::string text = "'";
  for (const char c : piece.substr(0, kLongest)) {
    if (c >= ' ' && c <= '~') {
      text += c;
    } else {
      text += "\\x";
      AppendHex(static_cast<std::uint8_t>(c), &text);
    }
  }
  return text + (piece.size() > kLongest ? "...'" : "'");
}

}  // namespace kdray::core
