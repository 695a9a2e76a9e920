// SPDX-License-Identifier: Apache-2.0
#include "api/json_cursor.h"

#include <algorithm>

#include "api/quoted.h"

namespace kdray::api {

std::uint64_t JsonLine(std::string_view text, const char* seen) {
  const char* last = seen == text.data() ? seen : seen - 1;
  return 1 + static_cast<std::uint64_t>(std::count(text.data(), last, '\n'));
}

Problem JsonProblem(ErrorCode code, std::string_view text, const char* seen, std::string detail,
                    std::optional<std::string> pointer) {
  Problem problem{code, std::move(detail), std::move(pointer)};
  problem.line = JsonLine(text, seen);
  return problem;
}

Check RefuseNul(std::string_view name, std::string_view text) {
  const std::size_t nul = text.find('\0');
  if (nul == std::string_view::npos) return std::nullopt;
  return JsonProblem(
      ErrorCode::kInvalidJson, text, text.data() + nul + 1,
      std::string(name) + " is not JSON: its byte " + std::to_string(nul) + " is NUL",
      std::nullopt);
}

Problem NotJson(std::string_view name, std::string_view text, const char* seen,
                std::string_view parser_message) {
  if (text.empty()) {
    return Problem{ErrorCode::kInvalidJson, std::string(name) + " is empty; JSON was expected"};
  }
  // "[json.exception.parse_error.101] parse error at line 1, column 3: syntax error while parsing
  // …"
  const std::size_t tag = parser_message.find("] ");
  if (tag != std::string_view::npos) parser_message.remove_prefix(tag + 2);
  // The part "last read: '…'" contains the body's last token, of any length.
  const std::size_t echo = parser_message.find("; last read: '");
  const std::size_t expected = parser_message.rfind("'; expected ");
  std::string detail(parser_message.substr(0, echo));
  if (echo != std::string_view::npos) {
    const std::size_t from = echo + std::string_view("; last read: '").size();
    std::string_view read = parser_message.substr(from);
    if (expected != std::string_view::npos && expected >= from) {
      read = read.substr(0, expected - from);
      detail += parser_message.substr(expected + 1);
    } else if (read.ends_with('\'')) {
      read.remove_suffix(1);
    }
    detail += "; last read: " + Quoted(read);
  }
  return JsonProblem(ErrorCode::kInvalidJson, text, seen,
                     std::string(name) + " is not JSON: " + detail, std::nullopt);
}

}  // namespace kdray::api
