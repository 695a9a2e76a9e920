// The service's errors: application/problem+json (RFC 9457) with kdray's own fields.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace kdray::client {

struct Problem {
  int status = 0;          ///< HTTP status
  std::string code;        ///< e.g. "tree_not_found"; empty when the answer was no problem document
  std::string detail;      ///< for people: where and what was allowed
  std::string request_id;  ///< what the server's log calls this request
  std::optional<std::string> parameter = {};  ///< name of a parameter, or JSON pointer
  std::optional<double> limit = {};
  std::optional<double> actual = {};
  std::optional<std::uint64_t> line = {};  ///< 1-based, in the mesh or JSON sent
};

/// Reads the body of an answer with an error status. Never fails: fields that are missing or of the
/// wrong kind stay empty, and a body that is no problem document (a proxy's error page, say) gives
/// one that says so.
Problem ParseProblem(int status, std::string_view body, std::string_view request_id);

/// Two lines for people, without a newline at the end: `code: detail`, and below it what helps to
/// look further. Control characters in the server's text are replaced, so that it cannot steer a
/// terminal.
std::string FormatProblem(const Problem& problem);

/// `text` with every control character but newline replaced by '?'.
std::string Printable(std::string_view text);

}  // namespace kdray::client
