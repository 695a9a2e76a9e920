// SPDX-License-Identifier: Apache-2.0
// The table of errors of the HTTP contract: code, status, title, meaning, Retry-After. The server's
// answers, the /problems/ pages, the documentation and the tests all use it. The codes and their
// names are those of the schema ProblemCode in api/openapi.yaml.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "api/names.h"

namespace kdray::api {

/// One row of the table.
struct ErrorRow {
  ErrorCode code;
  int status;              ///< HTTP status
  std::string_view title;  ///< `title` of the problem document
  /// A sentence or two for the /problems/<code> page: when it occurs and what to do.
  std::string_view meaning;
  int retry_after_s = 0;  ///< the Retry-After header; 0: none
};

/// All rows, in the order of the enumerators.
std::span<const ErrorRow> ErrorTable();
const ErrorRow& RowOf(ErrorCode code);
std::optional<ErrorCode> ParseErrorCode(std::string_view name);

/// An error for the client: becomes application/problem+json (RFC 9457).
struct Problem {
  ErrorCode code = ErrorCode::kInternal;
  std::string detail;  ///< says where the error is and what is allowed; nothing internal
  /// Name of a query parameter or header, or JSON pointer.
  std::optional<std::string> parameter = {};
  std::optional<double> limit = {};        ///< the bound that `actual` violates
  std::optional<double> actual = {};       ///< the value of the request
  std::optional<std::uint64_t> line = {};  ///< 1-based line of a text mesh or JSON body
};

}  // namespace kdray::api
