// SPDX-License-Identifier: Apache-2.0
// The trace that a client's request belongs to, from its header `traceparent`. Source: W3C Trace
// Context, section 3.2.
#pragma once

#include <optional>
#include <string_view>

namespace kdray::server {

/// Views of the header's value.
struct TraceContext {
  std::string_view trace_id;   ///< 32 lower-case hexadecimal digits
  std::string_view parent_id;  ///< 16 of them: the client's span
};

/// nullopt for a value that is invalid, or has an id of zeros.
std::optional<TraceContext> ParseTraceparent(std::string_view value);

}  // namespace kdray::server
