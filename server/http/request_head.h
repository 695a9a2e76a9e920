// SPDX-License-Identifier: Apache-2.0
// Parses the head of a request strictly: request line and header fields. Ambiguous heads are
// errors, because a body that is read as a request allows request smuggling. Source: RFC 9112
// (HTTP/1.1), sections 2 to 6.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <variant>

#include "api/errors.h"
#include "server/http/message.h"

namespace kdray::server {

struct HeadLimits {
  std::size_t bytes = 32 * 1024;     ///< headers_too_large
  std::size_t uri_bytes = 8 * 1024;  ///< uri_too_long
  std::size_t fields = 64;           ///< headers_too_large
};

struct RequestHead {
  std::string method;
  std::string path, query_string;    ///< origin-form, percent-encoded as sent; an absolute-form
                                     ///< target is reduced to it
  HttpHeaders headers;               ///< values without the blanks around them
  std::uint64_t content_length = 0;  ///< saturates
  bool chunked = false;              ///< the body has a length that its end tells
  bool expects_continue = false;
  bool keep_alive = true;
  bool is_1_0 = false;  ///< HTTP/1.0, which ends a connection unless both sides say keep-alive
};

/// An error, with the parts of the head that were parsed before it, for the log and for HEAD.
struct RefusedHead {
  RequestHead known;
  api::Problem problem;
};

/// `text` ends with the blank line. Errors: malformed_request, uri_too_long, headers_too_large,
/// length_required (a Transfer-Encoding other than `chunked`). Only POST, PUT and PATCH may have
/// bodies. O(bytes).
std::variant<RequestHead, RefusedHead> ParseRequestHead(std::string_view text,
                                                        const HeadLimits& limits);

/// The header Origin alone, found in the lines of `text`, which may be anything; empty without one.
/// A refusal for a page of another origin needs it.
HttpHeaders FindOrigin(std::string_view text);

/// RFC 9110, 5.5: a character that header values may have. No control character except the tab.
bool IsFieldValueChar(char c);
/// Whether the line, without its CR LF, is a name, a colon and a value (RFC 9112, 5).
bool IsFieldLine(std::string_view line);

/// Number of bytes up to and including the blank line that ends a head in `text`; 0 if it is not
/// complete. `from` is the size of `text` at the last call. A bare line feed ends lines too, so a
/// malformed head is complete and fails at once.
std::size_t FindHeadEnd(std::string_view text, std::size_t from);

}  // namespace kdray::server
