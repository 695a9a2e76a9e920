// SPDX-License-Identifier: Apache-2.0
// The service's errors: application/problem+json (RFC 9457) with kdray's own fields.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace kdray::client {

struct Problem {
  int status = 0;      ///< HTTP status
  std::string code;    ///< e.g. "tree_not_found"; empty if the answer was not a problem document
  std::string detail;  ///< for people: where the error is, and what is allowed
  std::string request_id;                     ///< the request's id in the server's log
  std::optional<std::string> parameter = {};  ///< name of a parameter, or JSON pointer
  std::optional<double> limit = {};
  std::optional<double> actual = {};
  std::optional<std::uint64_t> line = {};  ///< 1-based, in the mesh or JSON sent
};

/// Reads the body of an answer with an error status. Never fails: missing fields and fields of the
/// wrong kind stay empty. For a body that is not a problem document (for example a proxy's error
/// page), the detail says so.
Problem ParseProblem(int status, std::string_view body, std::string_view request_id);

/// Two lines for people, without a newline at the end: `code: detail`, then status, line, parameter
/// and request id. Control characters in the server's text are replaced, so it cannot control the
/// terminal.
std::string FormatProblem(const Problem& problem);

/// `text` with every control character but newline replaced by '?'.
std::string Printable(std::string_view text);

}  // namespace kdray::client
