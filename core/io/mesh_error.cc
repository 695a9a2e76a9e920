#include "core/io/mesh_error.h"

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
  constexpr char kDigits[] = "0123456789abcdef";
  std::string text = "'";
  for (const char c : piece.substr(0, kLongest)) {
    if (c >= ' ' && c <= '~') {
      text += c;
    } else {
      const auto byte = static_cast<unsigned char>(c);
      text += "\\x";
      text += kDigits[byte >> 4];
      text += kDigits[byte & 15];
    }
  }
  return text + (piece.size() > kLongest ? "...'" : "'");
}

}  // namespace kdray::core
